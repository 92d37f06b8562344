"""The perspective of a camera with an ordinary lens, for places that are not at mid-depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class View:
    """A lens whose axis is normal to the plane of the beam. Lengths are in the scale of mid-depth.

    Attributes
    ----------
    centre_mm : ndarray, shape (2,)
        The point at mid-depth that lies on the axis of the lens.
    stand_off_mm : float
        Distance from the pupil to that point.
    """

    centre_mm: Array
    stand_off_mm: float

    def seen(self, places_mm: Array) -> Array:
        """Return the image (..., 2) in mm of places (..., 3) in mm; z points away from the camera."""
        scale = self.stand_off_mm / (self.stand_off_mm + places_mm[..., 2:])
        return self.centre_mm + scale * (places_mm[..., :2] - self.centre_mm)
