"""Cut the image to the region that the beam can reach from its clamp, and scale the beam to a given width in pixels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.following.stated import StatedBeam

Array = NDArray[np.float64]

_REACH = 1.25  # beam lengths around the clamp that are cut out
_NORMAL_MEDIAN = 1.4826  # standard deviation of a normal distribution over its median absolute value
_LAPLACIAN_GAIN = 6.0  # standard deviation of [[1, -2, 1], [-2, 4, -2], [1, -2, 1]] applied to unit noise: √36


@dataclass(frozen=True)
class WorkingPicture:
    """A scaled part of an image, in which the program searches for the beam.

    Attributes
    ----------
    pixels : ndarray of float32, shape (height, width, channels)
        Grey values from 0 to 255.
    origin_px : ndarray, shape (2,)
        Upper left corner of this part in the image.
    factor : float
        Factor by which the part was enlarged.
    beam : StatedBeam
        Expected place and size of the beam in this picture.
    """

    pixels: NDArray[np.float32]
    origin_px: Array
    factor: float
    beam: StatedBeam

    @cached_property
    def noise(self) -> float:
        """Standard deviation of the noise of a colour channel, in grey levels."""
        return _noise(self.pixels)

    @cached_property
    def span(self) -> float:
        """Difference (grey levels) between the 99th and the 1st percentile of the pixels."""
        darkest, brightest = np.percentile(self.pixels[::3, ::3], (1, 99))
        return float(brightest - darkest)

    def to_picture(self, points: Array) -> Array:
        """Convert points from px of this scaled part to px of the whole picture."""
        return (points + 0.5) / self.factor - 0.5 + self.origin_px

    def from_picture(self, points: Array) -> Array:
        """Convert points from px of the whole picture to px of this scaled part."""
        return (points - self.origin_px + 0.5) * self.factor - 0.5


def working_picture(image: NDArray[Any], beam: StatedBeam, width_px: float) -> WorkingPicture | None:
    """Cut an image to the region that the beam can reach from its clamp, and scale this part.

    Parameters
    ----------
    image : ndarray, shape (H, W, channels)
        Grey values from 0 to 255; H rows, W columns.
    beam : StatedBeam
        Expected place and size of the beam in the image.
    width_px : float
        Desired width of the beam in the scaled picture.

    Returns
    -------
    WorkingPicture or None
        None if this region lies outside the image.
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
    # J. Immerkær, Computer Vision and Image Understanding 64 (1996) 300, with the median instead of the mean, so that
    # edges do not count as noise
    kernel = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], dtype=np.float32)
    differences = cv2.filter2D(pixels, cv2.CV_32F, kernel)[1:-1:2, 1:-1:2]  # a quarter of the pixels is enough
    return _NORMAL_MEDIAN * float(np.median(np.abs(differences))) / _LAPLACIAN_GAIN
