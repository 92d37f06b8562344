"""What bends the beam: magnet torque, gravity, a tip force. All are dead loads.

A dipole in a uniform field has the potential -B . R m, a weight W at s of a rigid body -W . (U + R s): both are
linear in the body's rotation matrix R, so a rigid end needs only a total force F and a 2 x 2 tensor Q with the
potential -F . U - Q : R.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eimi_fitting.specimen import STANDARD_GRAVITY

Array = NDArray[np.float64]


def _direction(angle_deg: float) -> Array:
    return np.array([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))])


@dataclass(frozen=True)
class Loads:
    """The K states of one specimen, in the beam frame.

    field_T: (K, 2); gravity: (K, 2) in m/s²; tip_force_N: (K, 2), whole specimen (not per depth).
    """

    field_T: Array
    gravity: Array
    tip_force_N: Array

    @staticmethod
    def along(
        field_mT: ArrayLike,
        field_angle_deg: float = 90.0,
        gravity_angle_deg: float | None = 0.0,
        tip_force_N: ArrayLike = 0.0,
    ) -> Loads:
        """K states from field magnitudes (K,) in mT and tip forces (K,) in N along gravity.

        Angles are in the beam frame, from +x toward +y; ``gravity_angle_deg=None`` switches gravity off (a tip
        force then needs no direction and must be zero, or ValueError is raised).
        """
        magnitude, force = np.broadcast_arrays(
            np.atleast_1d(np.asarray(field_mT, float)), np.asarray(tip_force_N, float)
        )
        if gravity_angle_deg is None:
            if np.any(force != 0):
                raise ValueError("a tip force acts along gravity, but no gravity angle is given")
            down = np.zeros(2)
        else:
            down = _direction(gravity_angle_deg)
        return Loads(
            1e-3 * magnitude[:, None] * _direction(field_angle_deg),
            np.tile(STANDARD_GRAVITY * down, (len(magnitude), 1)),
            force[:, None] * down,
        )

    def __len__(self) -> int:
        return len(self.field_T)

    def state(self, k: int) -> Array:
        """State k as one vector (6,): field, gravity, tip force."""
        return np.concatenate([self.field_T[k], self.gravity[k], self.tip_force_N[k]])
