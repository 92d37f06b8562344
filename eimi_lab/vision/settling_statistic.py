"""The settling ratio: decide whether two frames differ by more than the noise of the camera.

For two frames a and b, with the variance v of the noise at the grey level of each pixel,

    ratio = mean((b - a)²) / mean(2 v).

The means are taken over a band along the edges of the beam, where motion changes the grey values. The ratio is 1 for a
beam at rest. For a moving beam it exceeds 1 by an amount that grows with the square of the motion.

The variance as a function of the grey level (the photon transfer curve; J. R. Janesick, Photon Transfer, SPIE 2007) is
measured on frames at rest. No data sheet of the camera is needed.
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
STEEPEST_STEP = 2 * 2**0.5  # bound of the gradient of grey values from 0 to 1, smoothed: 4 (k0 + k1) sqrt(2) is 2.71
ROUNDING = 1e-5  # rounding error of the gradient, as a share of the largest grey value
STRIP_ROWS = 64
LEVELS = 24
FEWEST_PIXELS = 500  # that are needed to measure a variance
QUANTISATION = 1 / 12  # variance of rounding to whole grey levels


@dataclass(frozen=True)
class Noise:
    """Variance of the noise of a pixel as a function of its grey level.

    Attributes
    ----------
    levels : ndarray, shape (n,)
        The n grey levels in increasing order.
    variances : ndarray, shape (n,)
        Variance at each level, in grey levels squared.
    """

    levels: NDArray[np.float64]
    variances: NDArray[np.float64]

    @property
    def exceeds_rounding(self) -> bool:
        """Whether the noise is larger than the rounding to whole grey levels, whose variance is 1/12.

        A video or a computed frame may have no other noise.
        """
        return bool(self.variances.max() > QUANTISATION)

    def difference_ratio(
        self, earlier: NDArray[Any], later: NDArray[Any], pixels: NDArray[np.int64] | None = None
    ) -> float:
        """Return the settling ratio of two frames, which is 1 if the frames differ by the noise alone.

        The ratio is the mean squared difference of the frames, divided by the difference that noise alone causes.

        Parameters
        ----------
        earlier, later : ndarray, shape (H, W)
            The frames; H rows, W columns.
        pixels : ndarray of int, shape (n,), optional
            Indices of the n pixels to compare, in the flattened frames; by default the pixels near the edges in the
            later frame (`edge_pixels`).
        """
        chosen = edge_pixels(later) if pixels is None else pixels
        before, after = earlier.ravel()[chosen], later.ravel()[chosen]
        if before.dtype == after.dtype == np.uint8:  # a table gives the same values in less time
            expected = 2 * self._of_sums[before.astype(np.intp) + after]
            difference = after.astype(np.int32) - before
            return float(np.mean(difference * difference) / np.mean(expected))
        before, after = before.astype(np.float64), after.astype(np.float64)
        expected = 2 * np.interp((before + after) / 2, self.levels, self.variances)
        return float(np.mean((after - before) ** 2) / np.mean(expected))

    @cached_property
    def _of_sums(self) -> NDArray[np.float64]:
        """Variance of the noise at the mean of two 8-bit grey levels: a table, shape (511,).

        The index is the sum of the two grey levels.
        """
        return np.interp(np.arange(2 * np.iinfo(np.uint8).max + 1) / 2, self.levels, self.variances)


def measure_noise(frames: Sequence[NDArray[Any]]) -> Noise:
    """Measure the noise of the camera on frames of a beam at rest.

    The variance at a grey level is half the mean squared difference of two consecutive frames over the pixels of this
    grey level. The median over all pairs of consecutive frames is taken, so that a single disturbance of the beam has
    no effect.

    Parameters
    ----------
    frames : sequence of ndarray, shape (H, W) or (n,)
        At least two frames of H rows and W columns, or the same n pixels of at least two frames.

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
    first = frames[0].astype(np.float64)
    edges = np.unique(np.quantile(first, np.linspace(0, 1, LEVELS + 1)))
    level_index = np.clip(np.searchsorted(edges, first, side="right") - 1, 0, max(len(edges) - 2, 0)).ravel()
    count = np.bincount(level_index)
    half_squares = [
        np.bincount(level_index, weights=((b.astype(np.float64) - a) ** 2).ravel() / 2) / np.maximum(count, 1)
        for a, b in pairwise(frames)
    ]
    level = np.bincount(level_index, weights=first.ravel()) / np.maximum(count, 1)
    populated = count >= min(FEWEST_PIXELS, count.max())
    return Noise(level[populated], np.maximum(np.median(half_squares, axis=0)[populated], QUANTISATION))


def edge_band(image: NDArray[Any]) -> NDArray[np.bool_]:
    """Return whether each of H by W pixels is within 4 px (`EDGE_BAND_PX`) of a steep gradient, shape (H, W).

    A gradient is steep if it is at least a quarter of the steepest gradient in the image. The gradients are computed
    only where the range of the grey values permits a steep gradient, because their computation takes most of the time.
    """
    highest = _highest_steepness(image)
    strip, column = np.unravel_index(np.argmax(highest), highest.shape)
    left, right = max(int(column) - STRIP_ROWS, 0), int(column) + STRIP_ROWS
    steepest = _steepness(image, int(strip) * STRIP_ROWS, left, right).max()
    parts = []
    for number, possible in enumerate(highest):
        for left, right in _intervals(np.flatnonzero(possible >= EDGE_SHARE * steepest)):
            steepness = _steepness(image, number * STRIP_ROWS, left, right)
            steepest = max(steepest, steepness.max())
            parts.append((number * STRIP_ROWS, left, steepness))
    steep = np.zeros(image.shape, np.uint8)
    for top, left, steepness in parts:
        rows, columns = steepness.shape
        steep[top : top + rows, left : left + columns] = steepness >= EDGE_SHARE * steepest
    side = 2 * EDGE_BAND_PX + 1
    first, last = max(parts[0][0] - EDGE_BAND_PX, 0), parts[-1][0] + STRIP_ROWS + EDGE_BAND_PX
    left = max(min(left for _, left, _ in parts) - EDGE_BAND_PX, 0)
    right = max(left + steepness.shape[1] for _, left, steepness in parts) + EDGE_BAND_PX
    around = steep[first:last, left:right]
    around[:] = cv2.dilate(around, np.ones((side, side), np.uint8))
    return steep.view(np.bool_)


def _steepness(image: NDArray[Any], top: int, left: int, right: int) -> NDArray[Any]:
    """Return the steepness of the smoothed image in the strip of rows that begins at `top`, from `left` to `right`."""
    first_row, first_column = max(top - REACH_PX, 0), max(left - REACH_PX, 0)
    around = image[first_row : top + STRIP_ROWS + REACH_PX, first_column : right + REACH_PX]
    smooth = cv2.GaussianBlur(around.astype(np.float32), (0, 0), SMOOTHING_PX)
    steepness = cv2.magnitude(cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1))
    rows = slice(top - first_row, top - first_row + STRIP_ROWS)
    return steepness[rows, left - first_column : right - first_column]


def _highest_steepness(image: NDArray[Any]) -> NDArray[np.float32]:
    """Return, for each column of each strip of rows, a value that the steepness of the image cannot exceed.

    The image is divided into S strips of `STRIP_ROWS` rows; the shape is (S, W). The bound follows from the range of
    the grey values within `REACH_PX` of the column: the range times `STEEPEST_STEP`, plus the rounding error. It is
    computed faster than the steepness.
    """
    tops = range(0, image.shape[0], STRIP_ROWS)
    strips = [image[max(top - REACH_PX, 0) : top + STRIP_ROWS + REACH_PX] for top in tops]
    lowest, highest = (np.stack([f(strip, axis=0) for strip in strips]).astype(np.float32) for f in (np.min, np.max))
    near = np.ones((1, 2 * REACH_PX + 1), np.uint8)
    spread = cv2.dilate(highest, near) - cv2.erode(lowest, near)
    return np.asarray(STEEPEST_STEP * spread + ROUNDING * np.abs([lowest, highest]).max(), np.float32)


def _intervals(columns: NDArray[np.int64]) -> list[tuple[int, int]]:
    """Group columns of an image that are close together; return the first column and the end of each group.

    The end is the last column plus 1. `columns` holds column numbers in increasing order. Two groups that are at most
    `STRIP_ROWS` apart become one, because each separate computation costs time.
    """
    if not len(columns):
        return []
    gaps = np.flatnonzero(np.diff(columns) > STRIP_ROWS)
    return list(zip(columns[[0, *gaps + 1]].tolist(), (columns[[*gaps, -1]] + 1).tolist(), strict=True))


def edge_pixels(image: NDArray[Any]) -> NDArray[np.int64]:
    """Return the indices of the n pixels within 4 px of a steep gradient, in the flattened image, shape (n,)."""
    return np.flatnonzero(edge_band(image))
