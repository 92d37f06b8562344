"""What is known of the beam before its picture is looked at: by eye and by a ruler, not exactly."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StatedBeam:
    """Where the beam leaves its clamp and how large it is, in pixels.

    clamp_px: (2,) middle of the clamp line. axis_rad: direction of the beam there, clockwise from +x in the image.
    """

    clamp_px: Array
    axis_rad: float
    width_px: float
    length_px: float

    @property
    def ahead(self) -> Array:
        """(2,) unit vector away from the clamp."""
        return np.array([math.cos(self.axis_rad), math.sin(self.axis_rad)])

    def scaled(self, factor: float, origin_px: Array) -> StatedBeam:
        """The same beam in a picture cut at ``origin_px`` and enlarged by ``factor``; pixel centres are whole."""
        clamp = (self.clamp_px - origin_px + 0.5) * factor - 0.5
        return StatedBeam(clamp, self.axis_rad, self.width_px * factor, self.length_px * factor)
