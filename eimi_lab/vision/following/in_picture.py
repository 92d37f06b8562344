"""What calibration and specimen state of the beam in the picture, and the picture as it is searched."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.following.stated import StatedBeam
from eimi_lab.vision.intensity import full_scale


def stated_beam(frame: BeamFrame, length_mm: float, width_mm: float) -> StatedBeam:
    """The beam of so many millimetres where the calibration has its clamp."""
    origin, ahead = frame.to_px([[0.0, 0.0], [1.0, 0.0]])
    scale = float(np.linalg.norm(ahead - origin))
    angle = math.atan2(ahead[1] - origin[1], ahead[0] - origin[0])
    return StatedBeam(origin, angle, width_mm * scale, length_mm * scale)


def in_255(image: ArrayLike) -> NDArray[np.float32]:
    """(height, width, channels) float32 of 255, from an image (height, width) or (height, width, 3) of any depth."""
    pixels = np.asarray(image)
    pixels = np.ascontiguousarray(pixels[..., None] if pixels.ndim == 2 else pixels[..., :3], dtype=np.float32)
    if not np.isfinite(pixels).all():
        pixels = np.nan_to_num(pixels, posinf=0.0, neginf=0.0)
    largest = full_scale(pixels)
    return pixels if largest == 255.0 else pixels * np.float32(255.0 / largest)
