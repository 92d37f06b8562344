"""Compute clamp, axis, width and length of a beam in pixels, and scale the grey values of an image to 0 to 255."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eimi_fitting.beam.view import View
from eimi_lab.config.size_along import rows_of
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.following.stated import StatedBeam
from eimi_lab.vision.intensity import full_scale


def stated_beam(
    frame: BeamFrame, length_mm: float, width_mm: float, depth_mm: float = 0.0, view: View | None = None
) -> StatedBeam:
    """Return place and size of the beam in pixels, from the calibration (`frame`) and its size in mm.

    `view` is the perspective of the lens; None without perspective.
    """
    origin, ahead = frame.to_px([[0.0, 0.0], [1.0, 0.0]])
    scale = float(np.linalg.norm(ahead - origin))
    angle = math.atan2(ahead[1] - origin[1], ahead[0] - origin[0])
    rows = np.array(rows_of(width_mm))
    widths = rows / [length_mm, width_mm] if len(rows) else None
    beam = StatedBeam(origin, angle, width_mm * scale, length_mm * scale, widths=widths)
    if view is None:
        return beam
    near, far = (
        frame.to_px(view.seen(np.array([[0.0, 0.0, z_mm], [length_mm, 0.0, z_mm]])))
        for z_mm in (-0.5 * depth_mm, 0.5 * depth_mm)
    )
    apart = far - near
    along = near[1] - near[0]
    recession = -float((apart[1] - apart[0]) @ along / (along @ along))
    vanishing = near[0] + apart[0] / recession
    return replace(beam, depth_px=depth_mm * scale, vanishing_px=vanishing, recession=recession)


def in_255(image: ArrayLike) -> NDArray[np.float32]:
    """Return an image of any bit depth as float32 values from 0 to 255, shape (H, W, channels)."""
    pixels = np.asarray(image)
    pixels = np.ascontiguousarray(pixels[..., None] if pixels.ndim == 2 else pixels[..., :3], dtype=np.float32)
    if not np.isfinite(pixels).all():
        pixels = np.nan_to_num(pixels, posinf=0.0, neginf=0.0)
    largest = full_scale(pixels)
    return pixels if largest == 255.0 else pixels * np.float32(255.0 / largest)
