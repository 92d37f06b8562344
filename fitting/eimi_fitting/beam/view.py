"""How a camera with an ordinary lens sees places that are not at mid-depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class View:
    """centre_mm (2,) is where the lens's axis meets mid-depth; stand_off_mm: from the pupil to there.

    Places are as the scale of mid-depth has them.
    """

    centre_mm: Array
    stand_off_mm: float

    def seen(self, places_mm: Array) -> Array:
        """Where places (..., 3) appear (..., 2); z points away from the camera."""
        scale = self.stand_off_mm / (self.stand_off_mm + places_mm[..., 2:])
        return self.centre_mm + scale * (places_mm[..., :2] - self.centre_mm)
