"""What bends the beam: magnet torque, gravity, a tip force, magnetised silicone, all dead loads; pressure on a face.

A dipole in a uniform field has the potential -B . R m, a weight W at s of a rigid body -W . (U + R s): both are
linear in the body's rotation matrix R, so a rigid body needs only a total force F and a 2 x 2 tensor Q with the
potential -F . U - Q : R.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eimi_fitting.grid import Grid
from eimi_fitting.solid import Solid, SolidLoads
from eimi_fitting.specimen import STANDARD_GRAVITY

Array = NDArray[np.float64]


def _direction(angle_deg: float) -> Array:
    return np.array([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))])


@dataclass(frozen=True)
class Loads:
    """The K states of one specimen, in the beam frame.

    field_T: (K, 2); gravity: (K, 2) in m/s²; tip_force_N: (K, 2), whole specimen (not per depth); pressure_Pa: (K,)
    on the specimen's pressure face, positive into the body, one value for all states or none.
    """

    field_T: Array
    gravity: Array
    tip_force_N: Array
    pressure_Pa: ArrayLike = 0.0

    @staticmethod
    def along(
        field_mT: ArrayLike,
        field_angle_deg: float = 90.0,
        gravity_angle_deg: float | None = 0.0,
        tip_force_N: ArrayLike = 0.0,
        pressure_Pa: ArrayLike = 0.0,
    ) -> Loads:
        """K states from field magnitudes (K,) in mT, tip forces (K,) in N along gravity and pressures (K,).

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
            pressure_Pa,
        )

    def __len__(self) -> int:
        return len(self.field_T)

    def take(self, states: NDArray[np.intp]) -> Loads:
        """Some of the states, in the order given."""
        pressure = np.asarray(self.pressure_Pa, float)
        return Loads(
            self.field_T[states],
            self.gravity[states],
            self.tip_force_N[states],
            pressure[states] if pressure.ndim else pressure,
        )

    def state(self, k: int) -> Array:
        """State k as one vector (7,): field, gravity, tip force, pressure."""
        pressure = np.asarray(self.pressure_Pa, float)
        return np.concatenate(
            [self.field_T[k], self.gravity[k], self.tip_force_N[k], [pressure[k] if pressure.ndim else pressure]]
        )


class Actuation:
    """What one state's loads put on the mesh of a specimen, per mm of its depth."""

    def __init__(self, grid: Grid, solid: Solid) -> None:
        self._grid, self._specimen = grid, grid.specimen
        spec, magnet = grid.specimen, grid.specimen.magnet
        nodes = len(solid.mesh.nodes)
        self._mass = np.zeros(nodes)  # kg/mm
        np.add.at(self._mass, solid.mesh.elements, 1e-9 * spec.density_kg_m3 * solid.ops.load)
        slopes = np.zeros((nodes, 2))  # integrals of dN/dX, mm
        np.add.at(slopes, solid.mesh.elements, solid.ops.slope)
        # Hard-magnetic silicone: the energy -B . F M is linear in the displacement, so its forces are dead
        # (Zhao, Kim, Cianchetti, Zhao 2019, J. Mech. Phys. Solids 124:244). A/m T = J/m³ = 1e-6 N/mm².
        self._moments = 1e-6 * slopes @ np.array(spec.magnetisation_A_per_m)
        self._body_mass, self._body_moment, self._body_centre = 0.0, 0.0, np.zeros(2)
        if magnet:
            body = magnet.length_mm * magnet.width_mm * magnet.depth_mm
            around = grid.block_mm[0] * grid.block_mm[1] * spec.depth_mm - body  # silicone that is carried rigidly
            self._body_mass = 1e-9 * (body * magnet.density_kg_m3 + around * spec.density_kg_m3) / spec.depth_mm
            self._body_moment = 1e3 * magnet.moment_A_m2 / spec.depth_mm  # A m² = N m / T -> N mm / T, per mm
            self._body_centre = np.array([0.5 * magnet.length_mm, 0.0])  # of the block, from its inner face

    def at(self, load: Array, field_factor: Array) -> SolidLoads:
        """load: (7,), see `Loads.state`; field_factor: (B,) on the magnetic loads, or (1,) for all candidates."""
        gravity, tip_force = load[2:4], load[4:6]
        b = len(field_factor)
        field = field_factor[:, None] * load[0:2]  # (B, 2)
        nodal = self._mass[:, None] * gravity + self._moments[:, None] * field[:, None, :]
        force = np.empty((b, 2))
        force[:] = self._body_mass * gravity
        tensor = force[:, :, None] * self._body_centre
        tensor[:, :, 0] += self._body_moment * field
        if tip_force.any():
            spec = self._specimen
            point = np.array(spec.tip_load_mm if spec.tip_load_mm is not None else (spec.length_mm, 0.0))
            per_depth = tip_force / spec.depth_mm
            if self._grid.on_magnet(point)[0]:
                force += per_depth
                tensor += np.outer(per_depth, point - [spec.flexible_length_mm, 0.0])
            else:
                nodes, weights = self._grid.place(point)
                nodal[:, nodes[0]] += weights[0][:, None] * per_depth
        return SolidLoads(nodal, force, tensor, np.full(b, 1e-6 * load[6]))
