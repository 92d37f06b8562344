"""The settling statistic: whether two frames differ by the camera's noise alone, which they do at rest.

The measure is the mean squared difference of two frames over the variance that their noise gives it, inside a band
along the edges, where motion shows: 1 at rest. The noise is measured on frames at rest, as a function of grey level
(the photon transfer curve; Janesick, Photon Transfer, SPIE 2007), so that no camera data are needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

EDGE_BAND_PX = 4
EDGE_SHARE = 0.25  # of the steepest gradient
LEVELS = 24
FEWEST_PIXELS = 500  # that make a variance worth having
QUANTISATION = 1 / 12  # variance of rounding to whole grey levels


@dataclass(frozen=True)
class Noise:
    """Variance of a pixel's noise (grey levels squared) at increasing grey levels, both (n,)."""

    levels: NDArray[np.float64]
    variances: NDArray[np.float64]

    @property
    def seen(self) -> bool:
        """Whether there is noise at all beyond rounding; a video file or a drawn frame may have none."""
        return bool(self.variances.max() > QUANTISATION)

    def difference_ratio(self, earlier: NDArray[Any], later: NDArray[Any]) -> float:
        """Mean squared difference of two (H, W) frames over what their noise gives, along the edges of the later."""
        band = edge_band(later)
        before, after = earlier[band].astype(np.float64), later[band].astype(np.float64)
        expected = 2 * np.interp((before + after) / 2, self.levels, self.variances)
        return float(np.mean((after - before) ** 2) / np.mean(expected))


def measure_noise(frames: Sequence[NDArray[Any]]) -> Noise:
    """The noise in frames of a beam at rest, (H, W) each, at least two. Raises ValueError for fewer.

    The median over the pairs of frames passes over a beam that was touched once.
    """
    if len(frames) < 2:
        raise ValueError("noise needs at least two frames")
    first = frames[0].astype(np.float64)
    edges = np.unique(np.quantile(first, np.linspace(0, 1, LEVELS + 1)))
    of_level = np.clip(np.searchsorted(edges, first, side="right") - 1, 0, max(len(edges) - 2, 0)).ravel()
    count = np.bincount(of_level)
    half_squares = [
        np.bincount(of_level, weights=((b.astype(np.float64) - a) ** 2).ravel() / 2) / np.maximum(count, 1)
        for a, b in pairwise(frames)
    ]
    level = np.bincount(of_level, weights=first.ravel()) / np.maximum(count, 1)
    enough = count >= min(FEWEST_PIXELS, count.max())
    return Noise(level[enough], np.maximum(np.median(half_squares, axis=0)[enough], QUANTISATION))


def edge_band(image: NDArray[Any]) -> NDArray[np.bool_]:
    """(H, W): the pixels within a few of a steep gradient."""
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), 1.5)
    steepness = cv2.magnitude(cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1))
    steep = (steepness >= EDGE_SHARE * steepness.max()).astype(np.uint8)
    side = 2 * EDGE_BAND_PX + 1
    return cv2.dilate(steep, np.ones((side, side), np.uint8)).astype(bool)
