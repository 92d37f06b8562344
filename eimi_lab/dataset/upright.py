"""Rotation of the beam frame to the camera's view or, without a camera, such that gravity points down."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from eimi_lab.config.calibration import Calibration
from eimi_lab.vision.beam_frame import BeamFrame

Array = NDArray[np.float64]


def turn(calibration: Calibration | None, gravity_angle_deg: float | None) -> Array:
    """Return the matrix (2, 2) that maps (x, y) of the beam frame to (right, up).

    Parameters
    ----------
    calibration
        With a calibration, right and up are those of the image.
    gravity_angle_deg
        Without a calibration, gravity in this direction of the beam frame points downward. If this angle is None too,
        the identity is returned.
    """
    if calibration is not None:
        axis, hand = math.radians(calibration.axis_angle_deg), BeamFrame(calibration).hand
        return np.array([[math.cos(axis), -hand * math.sin(axis)], [-math.sin(axis), -hand * math.cos(axis)]])
    if gravity_angle_deg is None:
        return np.eye(2)
    by = math.radians(-90.0 - gravity_angle_deg)
    return np.array([[math.cos(by), -math.sin(by)], [math.sin(by), math.cos(by)]])
