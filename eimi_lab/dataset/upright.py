"""Rotate points from the axes of the beam to those of the camera's picture, or so that gravity points down."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from eimi_lab.config.calibration import Calibration
from eimi_lab.vision.beam_frame import BeamFrame

Array = NDArray[np.float64]


def turn(calibration: Calibration | None, gravity_angle_deg: float | None) -> Array:
    """Return the matrix (2, 2) that converts (x along the straight beam, y across it) into (right, up) in the picture.

    Parameters
    ----------
    calibration
        The calibration of the camera; None without a camera.
    gravity_angle_deg
        Direction of gravity, degrees from +x toward +y; not used with a camera. Without a camera, this direction points
        down in the picture, or the matrix is the identity if the direction is None.
    """
    if calibration is not None:
        axis, hand = math.radians(calibration.axis_angle_deg), BeamFrame(calibration).hand
        return np.array([[math.cos(axis), -hand * math.sin(axis)], [-math.sin(axis), -hand * math.cos(axis)]])
    if gravity_angle_deg is None:
        return np.eye(2)
    by = math.radians(-90.0 - gravity_angle_deg)
    return np.array([[math.cos(by), -math.sin(by)], [math.sin(by), math.cos(by)]])
