"""The built-in kinds of load: a field, gravity, a force at the tip, a pressure on a face."""

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
    """A uniform magnetic flux density, numbers (K, 2) in T, on the magnet and on magnetised silicone.

    The energy of hard-magnetic silicone, the integral of -B . F M with the deformation gradient F, is linear in the
    displacements, so its nodal forces are dead (Zhao, Kim, Cianchetti, Zhao 2019, J. Mech. Phys. Solids 124:244).
    """

    numbers: Array

    def take(self, states: States) -> UniformField:
        """Return the field in some of the states."""
        return UniformField(self.numbers[states])

    def apply(self, numbers: Array, field_factor: Array, mesh: LoadedMesh, total: SolidLoads) -> None:
        """Add B m' to the magnet's tensor and the dead forces on magnetised silicone to the nodes."""
        field = field_factor[:, None] * numbers  # (B, 2)
        total.tensor[:] += field[:, :, None] * mesh.magnet_dipole
        if mesh.nodal_dipole.any():
            total.nodal[..., :2] += mesh.nodal_dipole[:, None] * field[:, None, :]


@dataclass(frozen=True)
class CoilField:
    """The field of a coil that is not uniform, on the magnet and on magnetised silicone.

    Parameters
    ----------
    numbers : ndarray, shape (K, 2)
        The field in T at the place of the magnet at rest.
    shape : CoilShape
        Change of the field from place to place.
    """

    numbers: Array
    shape: CoilShape

    def take(self, states: States) -> CoilField:
        """Return the field in some of the states."""
        return CoilField(self.numbers[states], self.shape)

    def apply(self, numbers: Array, field_factor: Array, mesh: LoadedMesh, total: SolidLoads) -> None:
        """Put the magnet into the field of the coil; the load depends on the magnet's position."""
        field = field_factor[:, None] * numbers  # (B, 2)
        total.in_coil = DipoleInField(self.shape, mesh.magnet_dipole, mesh.magnet_centre_mm, mesh.magnet_face_mm, field)
        if mesh.nodal_dipole.any():
            total.silicone_in_coil = SiliconeInField(
                self.shape, mesh.field_place_mm, mesh.element_nodes_mm, mesh.element_share, mesh.element_dipole, field
            )


@dataclass(frozen=True)
class Gravity:
    """The acceleration of gravity, numbers (K, 2) in m/s²."""

    numbers: Array

    def take(self, states: States) -> Gravity:
        """Return gravity in some of the states."""
        return Gravity(self.numbers[states])

    def apply(self, numbers: Array, field_factor: Array, mesh: LoadedMesh, total: SolidLoads) -> None:
        """Add the weight of the silicone to the nodes, and the weight of the magnet to the rigid body."""
        total.nodal[..., :2] += mesh.nodal_mass[:, None] * numbers
        weight = mesh.magnet_mass * numbers
        total.force[:] += weight
        total.tensor[:] += np.outer(weight, mesh.magnet_centre_mm)


@dataclass(frozen=True)
class TipForce:
    """A force on the whole specimen, numbers (K, 2) in N, at ``Specimen.tip_load_mm`` or at the middle of the tip."""

    numbers: Array

    def take(self, states: States) -> TipForce:
        """Return the force in some of the states."""
        return TipForce(self.numbers[states])

    def apply(self, numbers: Array, field_factor: Array, mesh: LoadedMesh, total: SolidLoads) -> None:
        """Add the force to the nodes around its point, or to the magnet if the point is on the magnet."""
        straight = mesh.specimen.tip_load_mm or (mesh.specimen.length_mm, 0.0)
        mesh.apply_force(numbers * mesh.share, mesh.at_rest(np.array(straight)), total)


@dataclass(frozen=True)
class Pressure:
    """A pressure on the specimen's pressure face, numbers (K, 1) in Pa; see `beam.pressure`."""

    numbers: Array

    def take(self, states: States) -> Pressure:
        """Return the pressure in some of the states."""
        return Pressure(self.numbers[states])

    def apply(self, numbers: Array, field_factor: Array, mesh: LoadedMesh, total: SolidLoads) -> None:
        """Add the pressure.

        Raises
        ------
        ValueError
            The specimen has no face for a pressure, or is solved as a solid.
        """
        if mesh.is_solid:
            raise ValueError("the solid model takes no pressure_Pa: choose a planar section")
        if not mesh.has_pressure_face:
            raise ValueError("a pressure is given, but the specimen names no face for it")
        total.pressure[:] += MPA_PER_PA * numbers[0]
