"""The built-in kinds of load: a magnetic field, gravity, a force at the tip, and a pressure on a face."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.actuation import LoadedMesh
from eimi_fitting.beam.coil_field import CoilShape, DipoleInField, SiliconeInField
from eimi_fitting.beam.equilibrium import SolidLoads
from eimi_fitting.units import MPA_PER_PA

Array = NDArray[np.float64]
States = NDArray[np.intp]


@dataclass(frozen=True)
class UniformField:
    """A uniform magnetic field on the magnet and on magnetised silicone."""

    # (K, 2): components (x, y) of the magnetic flux density in T, in K load states.
    numbers: Array

    def take(self, states: States) -> UniformField:
        """Return the field in some of the load states only."""
        return UniformField(self.numbers[states])

    def apply(self, numbers: Array, field_factor: Array, mesh: LoadedMesh, total: SolidLoads) -> None:
        """Add the torque on the magnet and the forces on magnetised silicone to ``total``."""
        # ``numbers`` (2,): flux density (x, y) in T. ``field_factor`` (B,): factor on it for each of B candidate laws.
        field = field_factor[:, None] * numbers  # (B, 2)
        total.tensor[:] += field[:, :, None] * mesh.magnet_dipole
        # The energy of hard-magnetic silicone is linear in the displacements, so that the forces are dead loads (Zhao,
        # Kim, Cianchetti, Zhao 2019, J. Mech. Phys. Solids 124:244).
        if mesh.nodal_dipole.any():
            total.nodal[..., :2] += mesh.nodal_dipole[:, None] * field[:, None, :]


@dataclass(frozen=True)
class CoilField:
    """A non-uniform magnetic field of a coil on the magnet and on magnetised silicone."""

    # (K, 2): flux density (x, y) in T at the magnet at rest, in K load states.
    numbers: Array
    # The field at any point, relative to the field at the magnet at rest.
    shape: CoilShape

    def take(self, states: States) -> CoilField:
        """Return the field in some of the load states only."""
        return CoilField(self.numbers[states], self.shape)

    def apply(self, numbers: Array, field_factor: Array, mesh: LoadedMesh, total: SolidLoads) -> None:
        """Add the loads of the coil's field on the magnet and on magnetised silicone to ``total``."""
        # ``numbers`` (2,): flux density (x, y) in T. ``field_factor`` (B,): factor on it for each of B candidate laws.
        field = field_factor[:, None] * numbers  # (B, 2)
        total.in_coil = DipoleInField(self.shape, mesh.magnet_dipole, mesh.magnet_centre_mm, mesh.magnet_face_mm, field)
        if mesh.nodal_dipole.any():
            total.silicone_in_coil = SiliconeInField(
                self.shape, mesh.field_place_mm, mesh.element_nodes_mm, mesh.element_share, mesh.element_dipole, field
            )


@dataclass(frozen=True)
class Gravity:
    """The acceleration of gravity as a load on the specimen."""

    # (K, 2): components (x, y) of the acceleration in m/s², in K load states.
    numbers: Array

    def take(self, states: States) -> Gravity:
        """Return the acceleration of gravity in some of the load states only."""
        return Gravity(self.numbers[states])

    def apply(self, numbers: Array, field_factor: Array, mesh: LoadedMesh, total: SolidLoads) -> None:
        """Add the weight of the silicone and of the magnet to ``total``."""
        # ``numbers`` (2,): acceleration (x, y) in m/s².
        total.nodal[..., :2] += mesh.nodal_mass[:, None] * numbers
        weight = mesh.magnet_mass * numbers
        total.force[:] += weight
        total.tensor[:] += np.outer(weight, mesh.magnet_centre_mm)


@dataclass(frozen=True)
class TipForce:
    """A force on the specimen at the point ``Specimen.tip_load_mm``."""

    # (K, 2): components (x, y) of the force in N, in K load states.
    numbers: Array

    def take(self, states: States) -> TipForce:
        """Return the force in some of the load states only."""
        return TipForce(self.numbers[states])

    def apply(self, numbers: Array, field_factor: Array, mesh: LoadedMesh, total: SolidLoads) -> None:
        """Add the force to ``total``: to the magnet if it acts on the magnet, else to the nodes around its point."""
        # ``numbers`` (2,): force (x, y) in N.
        straight = mesh.specimen.tip_load_mm or (mesh.specimen.length_mm, 0.0)
        mesh.apply_force(numbers * mesh.share, mesh.at_rest(np.array(straight)), total)


@dataclass(frozen=True)
class Pressure:
    """A pressure on the face of the specimen that ``Specimen.pressure_face`` describes."""

    # (K, 1): pressure in Pa, in K load states.
    numbers: Array

    def take(self, states: States) -> Pressure:
        """Return the pressure in some of the load states only."""
        return Pressure(self.numbers[states])

    def apply(self, numbers: Array, field_factor: Array, mesh: LoadedMesh, total: SolidLoads) -> None:
        """Add the pressure to the sum of all pressures, in ``total``.

        Raises
        ------
        ValueError
            The specimen has no pressure face, or the beam model is solid.
        """
        # ``numbers`` (1,): pressure in Pa.
        if mesh.is_solid:
            raise ValueError(
                'pressure_Pa is not possible with section = "solid": choose section = "plane-stress" or "plane-strain"'
            )
        if not mesh.has_pressure_face:
            raise ValueError("pressure_Pa is given, but the specimen has no pressure_face on which it can act")
        total.pressure[:] += MPA_PER_PA * numbers[0]
