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
            The frames.
        pixels : ndarray of int, shape (n,), optional
            Indices of the pixels to compare, in the flattened frames; by default the pixels near the edges in the later
            frame (`edge_pixels`).
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
        """Noise variance at the mean of two 8-bit grey levels, indexed by the sum of the two levels, shape (511,)."""
        return np.interp(np.arange(2 * np.iinfo(np.uint8).max + 1) / 2, self.levels, self.variances)


def measure_noise(frames: Sequence[NDArray[Any]]) -> Noise:
    """Measure the noise of the camera on frames of a beam at rest.

    The variance at a grey level is half the mean squared difference of two consecutive frames over the pixels of this
    grey level. The median over all pairs of consecutive frames is taken, so that a single disturbance of the beam has
    no effect.

    Parameters
    ----------
    frames : sequence of ndarray, shape (H, W) or (n,)
        At least two frames, or the same pixels of at least two frames.

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
    """Return whether each pixel of an image is within 4 px (`EDGE_BAND_PX`) of a steep gradient, shape (H, W).

    A gradient is steep if it is at least a quarter of the steepest gradient in the image.
    """
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), 1.5)
    steepness = cv2.magnitude(cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1))
    steep = (steepness >= EDGE_SHARE * steepness.max()).astype(np.uint8)
    side = 2 * EDGE_BAND_PX + 1
    return cv2.dilate(steep, np.ones((side, side), np.uint8)).astype(bool)


def edge_pixels(image: NDArray[Any]) -> NDArray[np.int64]:
    """Return the indices of the n pixels within 4 px of a steep gradient, in the flattened image, shape (n,)."""
    return np.flatnonzero(edge_band(image))
