"""What bends the beam: magnet torque, gravity, a tip force, magnetised silicone, all dead loads; pressure on a face.

A dipole in a uniform field has the potential -B . R m, a weight W at s of a rigid body -W . (U + R s): both are
linear in the body's rotation matrix R, so a rigid body needs only a total force F and a 2 x 2 tensor Q with the
potential -F . U - Q : R.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import prod
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eimi_fitting.beam.equilibrium import Solid, SolidLoads
from eimi_fitting.beam.mesh import Indices
from eimi_fitting.beam.specimen import STANDARD_GRAVITY, Specimen
from eimi_fitting.units import MPA_PER_PA

Array = NDArray[np.float64]


def _direction(angle_deg: ArrayLike) -> Array:
    """(2,) or (2, K) of one angle or K of them."""
    return np.array([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))])


@dataclass(frozen=True)
class Loads:
    """The K states of one specimen, in the beam frame.

    field_T: (K, 2); gravity: (K, 2) in m/s²; tip_force_N: (K, 2), whole specimen (not per depth); pressure_Pa: (K,)
    on the specimen's pressure face, positive into the body, one value for all states or none.

    Examples
    --------
    Two fields across a beam that hangs down:

    >>> loads = Loads.along([0.0, 7.0])
    >>> loads.field_T.round(6).tolist()
    [[0.0, 0.0], [0.0, 0.007]]
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
        tip_force_angle_deg: ArrayLike | None = None,
    ) -> Loads:
        """K states from field magnitudes (K,) in mT, tip forces (K,) in N and pressures (K,).

        Angles are in the beam frame, from +x toward +y; ``gravity_angle_deg=None`` switches gravity off. Tip forces act
        along gravity unless an angle, or (K,) of them, says otherwise; ValueError for a force without a direction.
        """
        magnitude, force = np.broadcast_arrays(
            np.atleast_1d(np.asarray(field_mT, float)), np.asarray(tip_force_N, float)
        )
        down = np.zeros(2) if gravity_angle_deg is None else _direction(gravity_angle_deg)
        if tip_force_angle_deg is None:
            if gravity_angle_deg is None and np.any(force != 0):
                raise ValueError("a tip force acts along gravity, but neither gravity's angle nor its own is given")
            along = down
        else:
            along = _direction(tip_force_angle_deg).T
        return Loads(
            1e-3 * magnitude[:, None] * _direction(field_angle_deg),
            np.tile(STANDARD_GRAVITY * down, (len(magnitude), 1)),
            force[:, None] * along,
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


class Places(Protocol):
    """What the loads ask of a grid: see `Grid` and `SolidGrid`."""

    specimen: Specimen
    block_mm: tuple[float, float, float]
    per_specimen: float

    def on_magnet(self, points_mm: Array) -> NDArray[np.bool_]:
        """(n,): which points (n, 2), given at rest, the magnet carries."""

    def through_depth(self, point_mm: Array) -> tuple[Indices, Array]:
        """Nodes and weights that take a force on the line in depth through a point (2,)."""


class Actuation:
    """What one state's loads put on a mesh of a specimen: per mm of its depth where it is planar, or on half of it."""

    def __init__(self, grid: Places, solid: Solid) -> None:
        self._grid, self._specimen = grid, grid.specimen
        spec, magnet = grid.specimen, grid.specimen.magnet
        nodes, self._dimensions = solid.mesh.nodes.shape
        self._mass = np.zeros(nodes)  # kg/mm, kg
        np.add.at(self._mass, solid.mesh.elements, 1e-9 * spec.density_kg_m3 * solid.ops.load)
        slopes = np.zeros((nodes, self._dimensions))  # integrals of dN/dX
        np.add.at(slopes, solid.mesh.elements, solid.ops.slope)
        # Hard-magnetic silicone: the energy -B . F M is linear in the displacement, so its forces are dead
        # (Zhao, Kim, Cianchetti, Zhao 2019, J. Mech. Phys. Solids 124:244). A/m T = J/m³ = Pa.
        self._moments = MPA_PER_PA * slopes[:, :2] @ np.array(spec.magnetisation_A_per_m)
        self._body = solid.body
        self._body_mass, self._body_moment, self._body_centre = 0.0, 0.0, np.zeros(2)
        if magnet:
            part = grid.per_specimen
            body = magnet.length_mm * magnet.width_mm * magnet.depth_mm
            around = prod(grid.block_mm) - body  # silicone that is carried rigidly
            self._body_mass = 1e-9 * (body * magnet.density_kg_m3 + around * spec.density_kg_m3) * part
            self._body_moment = 1e3 * magnet.moment_A_m2 * part  # A m² = N m / T -> N mm / T
            self._body_centre = np.array([0.5 * magnet.length_mm, 0.0])  # of the block, from its inner face

    def at(self, load: Array, field_factor: Array) -> SolidLoads:
        """load: (7,), see `Loads.state`; field_factor: (B,) on the magnetic loads, or (1,) for all candidates."""
        gravity, tip_force = load[2:4], load[4:6] * self._grid.per_specimen
        b = len(field_factor)
        field = field_factor[:, None] * load[0:2]  # (B, 2)
        nodal = np.zeros((b, len(self._mass), self._dimensions))
        nodal[..., :2] = self._mass[:, None] * gravity + self._moments[:, None] * field[:, None, :]
        force = np.empty((b, 2))
        force[:] = self._body_mass * gravity
        tensor = force[:, :, None] * self._body_centre
        tensor[:, :, 0] += self._body_moment * field
        if tip_force.any():
            spec = self._specimen
            point = np.array(spec.tip_load_mm if spec.tip_load_mm is not None else (spec.length_mm, 0.0))
            if self._grid.on_magnet(point)[0]:
                force += tip_force
                tensor += np.outer(tip_force, point - [spec.flexible_length_mm, 0.0])
            else:
                nodes, weights = self._grid.through_depth(point)
                shares = np.zeros((len(self._mass), 2))
                np.add.at(shares, nodes, weights[..., None] * tip_force)
                nodal[..., :2] += shares
        if self._body:  # what the silicone's loads put on the nodes that it carries
            carried = nodal[:, self._body.nodes, :2]
            force += carried.sum(axis=1)
            tensor += np.einsum("bni,nj->bij", carried, self._body.arms)
        return SolidLoads(nodal, force, tensor, np.full(b, MPA_PER_PA * load[6]))
