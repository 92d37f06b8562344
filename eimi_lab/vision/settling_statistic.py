"""Decide whether two frames differ by more than the noise of the camera.

For two frames a and b with the variance v of the noise at each pixel, ratio = mean((b - a)²) / mean(2 v) over pixels
near the edges. It is 1 at rest. The variance is measured on frames at rest (J. R. Janesick, Photon Transfer, SPIE
2007).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

EDGE_BAND_PX = 4
EDGE_SHARE = 0.25  # of the steepest gradient
SMOOTHING_PX = 1.5  # standard deviation of the Gaussian before the gradient
REACH_PX = 7  # of the gradient: 6 for the Gaussian, 1 for the Sobel operator
# An upper bound of the gradient of smoothed grey values from 0 to 1. The largest value is 4 (k0 + k1) sqrt(2) = 2.71,
# where k0 and k1 are the two largest different weights of the Gaussian.
STEEPEST_STEP = 2 * 2**0.5
ROUNDING = 1e-5  # rounding error of the gradient, as a share of the largest grey value
STRIP_ROWS = 64
SPARE_COLUMNS = 64  # computing the steepness of so many more columns takes as long as another computation
LEVELS = 24
FEWEST_PIXELS = 500  # that are needed to measure a variance
QUANTISATION = 1 / 12  # variance of rounding to whole grey levels


@dataclass(frozen=True)
class Noise:
    """Variance of the noise of a pixel as a function of its grey level.

    Attributes
    ----------
    levels : ndarray, shape (n,)
        Grey levels in increasing order.
    variances : ndarray, shape (n,)
        Variance at each level, in grey levels squared.
    """

    levels: NDArray[np.float64]
    variances: NDArray[np.float64]

    @property
    def exceeds_rounding(self) -> bool:
        """Whether the noise is larger than the rounding to whole grey levels."""
        return bool(self.variances.max() > QUANTISATION)

    def difference_ratio(
        self, earlier: NDArray[Any], later: NDArray[Any], pixels: NDArray[np.int64] | None = None
    ) -> float:
        """Return the mean squared difference of two frames, divided by the value that noise alone causes.

        Parameters
        ----------
        earlier, later : ndarray, shape (rows, columns)
            The frames.
        pixels : ndarray of int, shape (n,), optional
            Flat indices of the pixels to compare; by default the pixels near the edges in the later frame.
        """
        chosen = edge_pixels(later) if pixels is None else pixels
        before, after = earlier.ravel()[chosen], later.ravel()[chosen]
        if before.dtype == after.dtype == np.uint8:  # a table gives the same values in less time
            expected = self._variances_by_sum.take(np.add(before, after, dtype=np.intp))
            return float(cv2.norm(after, before, cv2.NORM_L2SQR) / len(chosen) / (2 * np.mean(expected)))
        before, after = before.astype(np.float64), after.astype(np.float64)
        expected = 2 * np.interp((before + after) / 2, self.levels, self.variances)
        return float(np.mean((after - before) ** 2) / np.mean(expected))

    @cached_property
    def _variances_by_sum(self) -> NDArray[np.float64]:
        """Variance of the noise, indexed by the sum of the grey levels of a pixel in two 8-bit frames, shape (511,)."""
        return np.interp(np.arange(2 * np.iinfo(np.uint8).max + 1) / 2, self.levels, self.variances)


def measure_noise(frames: Sequence[NDArray[Any]]) -> Noise:
    """Measure the noise of the camera on frames of a beam at rest.

    Parameters
    ----------
    frames : sequence of ndarray, shape (rows, columns) or (n,)
        At least two frames, or n selected pixels of at least two frames.

    Returns
    -------
    Noise
        The variance of the noise as a function of the grey level.

    Raises
    ------
    ValueError
        If there are fewer than two frames.
    """
    if len(frames) < 2:
        raise ValueError("the noise of the camera is measured on at least two frames, but fewer frames are given")
    # The mean of the frames is independent of their differences; the grey value of one frame is not.
    mean = np.mean(frames, axis=0, dtype=np.float64)
    edges = np.unique(np.quantile(mean, np.linspace(0, 1, LEVELS + 1)))
    level_index = np.clip(np.searchsorted(edges, mean, side="right") - 1, 0, max(len(edges) - 2, 0)).ravel()
    count = np.bincount(level_index)
    half_squares = [
        np.bincount(level_index, weights=((b.astype(np.float64) - a) ** 2).ravel() / 2) / np.maximum(count, 1)
        for a, b in pairwise(frames)
    ]
    level = np.bincount(level_index, weights=mean.ravel()) / np.maximum(count, 1)
    populated = count >= min(FEWEST_PIXELS, count.max())
    return Noise(level[populated], np.maximum(np.median(half_squares, axis=0)[populated], QUANTISATION))


def edge_band(image: NDArray[Any]) -> NDArray[np.bool_]:
    """Return which pixels of an image are within 4 px of a steep gradient, shape (rows, columns)."""
    band = np.zeros(image.shape, np.bool_)
    band.ravel()[edge_pixels(image)] = True
    return band


def edge_pixels(image: NDArray[Any]) -> NDArray[np.int64]:
    """Return the flat indices of the pixels within 4 px of a steep gradient, shape (n,)."""
    # Gradients take most of the time, and are computed only where the range of grey values permits a steep one.
    highest = _highest_steepness(image)
    strip, column = np.unravel_index(np.argmax(highest), highest.shape)
    top, left = int(strip) * STRIP_ROWS, max(int(column) - REACH_PX, 0)
    steepest = _steepness(image, top, top + STRIP_ROWS, left, int(column) + REACH_PX).max()
    rectangles = _rectangles(highest >= EDGE_SHARE * steepest)
    parts = [_steepness(image, *rectangle) for rectangle in rectangles]
    steepest = max(steepest, *(part.max() for part in parts))
    tops, _, lefts, _ = zip(*rectangles, strict=True)
    first_row, first_column = max(min(tops) - EDGE_BAND_PX, 0), max(min(lefts) - EDGE_BAND_PX, 0)
    last_row = max(top + len(part) for top, part in zip(tops, parts, strict=True)) + EDGE_BAND_PX
    last_column = max(left + part.shape[1] for left, part in zip(lefts, parts, strict=True)) + EDGE_BAND_PX
    height, width = image.shape
    steep = np.zeros((min(last_row, height) - first_row, min(last_column, width) - first_column), np.uint8)
    for top, left, part in zip(tops, lefts, parts, strict=True):
        first, begin = top - first_row, left - first_column
        steep[first : first + part.shape[0], begin : begin + part.shape[1]] |= part >= EDGE_SHARE * steepest
    side = 2 * EDGE_BAND_PX + 1
    inside = np.flatnonzero(cv2.dilate(steep, np.ones((side, side), np.uint8)).view(np.bool_))
    columns = steep.shape[1]
    return inside + inside // columns * (width - columns) + (first_row * width + first_column)


def _steepness(image: NDArray[Any], top: int, bottom: int, left: int, right: int) -> NDArray[Any]:
    """Return the magnitude of the gradient of the smoothed image in a rectangle; `bottom` and `right` are excluded."""
    first_row, first_column = max(top - REACH_PX, 0), max(left - REACH_PX, 0)
    around = image[first_row : bottom + REACH_PX, first_column : right + REACH_PX]
    smooth = cv2.GaussianBlur(around.astype(np.float32), (0, 0), SMOOTHING_PX)
    steepness = cv2.magnitude(cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1))
    return steepness[top - first_row : bottom - first_row, left - first_column : right - first_column]


def _highest_steepness(image: NDArray[Any]) -> NDArray[np.float32]:
    """Return an upper bound of the gradient in each column of each strip of 64 rows, shape (strips, columns)."""
    height, width = image.shape
    tops = range(0, height, STRIP_ROWS)
    lowest, highest = np.empty((2, len(tops), width), image.dtype)
    for number, top in enumerate(tops):
        strip = image[max(top - REACH_PX, 0) : top + STRIP_ROWS + REACH_PX]
        np.minimum.reduce(strip, axis=0, out=lowest[number])
        np.maximum.reduce(strip, axis=0, out=highest[number])
    near = np.ones((1, 2 * REACH_PX + 1), np.uint8)
    lowest, highest = cv2.erode(lowest, near), cv2.dilate(highest, near)
    spread = np.subtract(highest, lowest, dtype=np.float32)
    largest = max(abs(float(lowest.min())), abs(float(highest.max())))
    return np.asarray(STEEPEST_STEP * spread + ROUNDING * largest, np.float32)


def _rectangles(may_be_steep: NDArray[np.bool_]) -> list[tuple[int, int, int, int]]:
    """Return rectangles (top, bottom, left, right, px) that contain all pixels where `may_be_steep` is True."""
    # An element of `may_be_steep` is one column of a strip of 64 rows of the image, shape (strips, columns).
    strips, columns = np.divmod(np.flatnonzero(may_be_steep), may_be_steep.shape[1])
    ends = np.flatnonzero((np.diff(strips) > 0) | (np.diff(columns) > STRIP_ROWS))
    first, last = [0, *(ends + 1)], [*ends, -1]
    rectangles: list[tuple[int, int, int, int]] = []  # counted in strips instead of rows
    # Few large rectangles take less time than many small ones; neighbours are joined if this adds little area.
    for strip, left, right in zip(strips[first].tolist(), columns[first].tolist(), columns[last].tolist(), strict=True):
        here = (strip, strip + 1, left, right + 1)
        for number, above in enumerate(rectangles):
            both = (above[0], strip + 1, min(above[2], left), max(above[3], right + 1))
            if above[1] == strip and _size(both) - _size(above) - _size(here) <= SPARE_COLUMNS:
                rectangles[number] = both
                break
        else:
            rectangles.append(here)
    return [(top * STRIP_ROWS, bottom * STRIP_ROWS, left, right) for top, bottom, left, right in rectangles]


def _size(rectangle: tuple[int, int, int, int]) -> int:
    top, bottom, left, right = rectangle
    return (bottom - top) * (right - left)
