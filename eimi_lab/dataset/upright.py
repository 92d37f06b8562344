"""Places of the beam frame turned to how the beam is seen: as before the camera, or with gravity downward."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from eimi_lab.config.calibration import Calibration
from eimi_lab.vision.beam_frame import BeamFrame

Array = NDArray[np.float64]


def turn(calibration: Calibration | None, gravity_angle_deg: float | None) -> Array:
    """(2, 2): takes (x, y) of the beam frame to (to the right, up), both in mm.

    As the camera has them; without one with gravity downward, and as in the beam frame where that has no direction.
    """
    if calibration is not None:
        axis, hand = math.radians(calibration.axis_angle_deg), BeamFrame(calibration).hand
        return np.array([[math.cos(axis), -hand * math.sin(axis)], [-math.sin(axis), -hand * math.cos(axis)]])
    if gravity_angle_deg is None:
        return np.eye(2)
    by = math.radians(-90.0 - gravity_angle_deg)
    return np.array([[math.cos(by), -math.sin(by)], [math.sin(by), math.cos(by)]])
