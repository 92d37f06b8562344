"""The picture in which the beam is looked for: what it can reach, scaled so that its width is a few pixels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.following.stated import StatedBeam

Array = NDArray[np.float64]

_REACH = 1.25  # beam lengths around the clamp
_NORMAL_MEDIAN = 1.4826
_LAPLACIAN_GAIN = 6.0  # standard deviation of [[1, -2, 1], [-2, 4, -2], [1, -2, 1]] on noise of one: the root of 36


@dataclass(frozen=True)
class WorkingPicture:
    """A stretch of a picture, scaled.

    pixels: (height, width, channels) float32, of 255. origin_px, factor: where it was cut and by what it was
    enlarged. beam: the stated beam in it.
    """

    pixels: NDArray[np.float32]
    origin_px: Array
    factor: float
    beam: StatedBeam

    @cached_property
    def noise(self) -> float:
        """Standard deviation of a channel."""
        return _noise(self.pixels)

    @cached_property
    def span(self) -> float:
        """From the darkest to the brightest hundredth."""
        darkest, brightest = np.percentile(self.pixels[::3, ::3], (1, 99))
        return float(brightest - darkest)

    def to_picture(self, points: Array) -> Array:
        """Places (..., 2) of this picture in the whole one."""
        return (points + 0.5) / self.factor - 0.5 + self.origin_px

    def from_picture(self, points: Array) -> Array:
        """Places (..., 2) of the whole picture in this one."""
        return (points - self.origin_px + 0.5) * self.factor - 0.5


def working_picture(image: NDArray[Any], beam: StatedBeam, width_px: float) -> WorkingPicture | None:
    """Cut and scale an image (height, width, channels) of 255 so that the beam is about ``width_px`` wide.

    None where the beam's reach has no place in it.
    """
    high, wide = image.shape[:2]
    reach = _REACH * beam.length_px + 2.0 * beam.width_px
    low = np.clip(np.floor(beam.clamp_px - reach), 0, [wide, high]).astype(int)
    top = np.clip(np.ceil(beam.clamp_px + reach) + 1, 0, [wide, high]).astype(int)
    if (top - low < 3).any():
        return None
    cut = image[low[1] : top[1], low[0] : top[0]]
    factor = width_px / beam.width_px
    size = np.maximum(np.rint((top - low) * factor), 3).astype(int)
    kind = cv2.INTER_AREA if factor < 1.0 else cv2.INTER_LINEAR
    pixels = cv2.resize(cut, (int(size[0]), int(size[1])), interpolation=kind).astype(np.float32)
    pixels = pixels.reshape(*pixels.shape[:2], -1)
    stated = beam.scaled(factor, low.astype(np.float64))
    return WorkingPicture(pixels, low.astype(np.float64), factor, stated)


def _noise(pixels: NDArray[np.float32]) -> float:
    """Standard deviation of a channel, from second differences of second differences, which smooth light leaves at 0.

    J. Immerkær, Fast noise variance estimation, Computer Vision and Image Understanding 64 (1996) 300; with the median
    in place of the mean, for edges are no noise.
    """
    kernel = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], dtype=np.float32)
    left_over = cv2.filter2D(pixels, cv2.CV_32F, kernel)[1:-1:2, 1:-1:2]  # so many tell it as well
    return _NORMAL_MEDIAN * float(np.median(np.abs(left_over))) / _LAPLACIAN_GAIN
