"""The interface of one kind of load, with its values in each load state and its forces on a mesh."""

# A dead load keeps its direction and size. With the translation U of the rigid magnet and the matrix R of its rotation
# theta, the potential of a dead load on the magnet is -F . U - Q : R - M theta (force F, tensor Q, moment M).

from __future__ import annotations

from math import prod
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.equilibrium import Solid, SolidLoads
from eimi_fitting.beam.mesh import Indices
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.beam.strip import Strip
from eimi_fitting.units import MPA_PER_PA

Array = NDArray[np.float64]


class Actuation(Protocol):
    """One kind of load on a beam, such as a force at the tip, in a sequence of load states.

    The forces on the mesh must be linear in the components of the load.
    """

    @property
    def numbers(self) -> Array:
        """The components of the load, such as those of a force, one row for each load state."""
        ...

    def take(self, states: NDArray[np.intp]) -> Self:
        """Return the load in some of the load states only."""
        ...

    def apply(self, numbers: Array, field_factor: Array, mesh: LoadedMesh, total: SolidLoads) -> None:
        """Add the load of one load state to the sum of all loads, in place.

        Parameters
        ----------
        numbers : ndarray, shape (m,)
            The components of the load in this state, such as those of a force.
        field_factor : ndarray, shape (B,)
            Factor on magnetic loads for each of B candidate laws.
        mesh : LoadedMesh
            The mesh. The fraction ``mesh.share`` of a force on the specimen acts on the mesh.
        total : SolidLoads
            The sum of all loads.
        """
        ...


class Places(Protocol):
    """The geometry of a meshed specimen: the place of the magnet, and the nodes that share a force."""

    specimen: Specimen
    strip: Strip
    straight_mm: Array
    block_mm: tuple[float, float, float]
    face_mm: tuple[float, float]
    turn_rad: float
    per_specimen: float

    def straightened(self, points_mm: Array) -> Array:
        """Map points of the unloaded specimen to the straight reference beam."""

    def on_magnet(self, points_mm: Array) -> NDArray[np.bool_]:
        """Return whether each point moves rigidly with the magnet."""
        # ``points_mm`` (n, 2): points (x, y) of the straight reference beam.

    def through_depth(self, point_mm: Array) -> tuple[Indices, Array]:
        """Distribute a point force through the depth; return the nodes and the fraction of the force on each."""
        # The force is spread over m elements of n nodes through the depth: (m, n) each. ``point_mm``: the point (x, y)
        # in the straight reference beam.


def _turned(vector: Array, angle_rad: Array | float) -> Array:
    """Rotate a vector (x, y) by one angle or by several angles."""
    # Several angles (n,) give (2, n).
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


class LoadedMesh:
    """The mesh of a specimen, with the integrals that are needed to compute loads."""

    # N nodes with d coordinates, and E elements with n nodes each.
    # ``share``: the fraction of a load on the specimen that acts on the mesh.
    # ``nodal_mass`` (N,): mass of the silicone at each node in kg (in kg/mm for a planar mesh).
    # ``slopes`` (N, d): integrals of the derivatives of the shape functions in mm² (in mm for a planar mesh).
    # ``nodal_dipole`` (N,): forces on the nodes of magnetised silicone, divided by a uniform field, in N/T.
    # ``element_dipole`` (E, n): the contribution of each element to ``nodal_dipole``.
    # ``element_share`` (E, n): weights of an element's nodes that give the middle of the element.
    # ``element_nodes_mm`` (E, n, 2): positions (x, y) at rest of the nodes of each element.
    # ``field_place_mm`` (2,): the point (x, y) at rest at which a non-uniform field is specified.
    # ``magnet_mass``: mass of the magnet and of the silicone that moves rigidly with it, in the unit of ``nodal_mass``.
    # ``magnet_face_mm`` (2,): the middle (x, y) at rest of the magnet's inner face.
    # ``magnet_centre_mm`` (2,): vector (x, y) at rest from the inner face to the middle of the magnet.
    # ``magnet_dipole`` (2,): magnetic moment (x, y) at rest in N mm/T.

    def __init__(self, grid: Places, solid: Solid) -> None:
        self.specimen, self.share = grid.specimen, grid.per_specimen
        self._grid, self._solid = grid, solid
        specimen, magnet = grid.specimen, grid.specimen.magnet
        elements = solid.mesh.elements
        nodes, self._dimensions = solid.mesh.nodes.shape
        self.nodal_mass = np.zeros(nodes)
        np.add.at(self.nodal_mass, elements, 1e-9 * specimen.density_kg_m3 * solid.ops.load)
        self.slopes = np.zeros((nodes, self._dimensions))
        np.add.at(self.slopes, elements, solid.ops.slope)
        # A/m T = J/m³ = Pa
        self.nodal_dipole = np.zeros(nodes)
        if any(specimen.magnetisation_A_per_m):
            angle = grid.strip.angle_rad(grid.straight_mm[elements][:, :, 0].mean(axis=1))
            magnetisation = _turned(np.array(specimen.magnetisation_A_per_m), angle)
            dipoles = np.einsum("eai,ie->ea", solid.ops.slope[..., :2], magnetisation)
            np.add.at(self.nodal_dipole, elements, MPA_PER_PA * dipoles)
            self.element_dipole = MPA_PER_PA * dipoles
            self.element_share = solid.ops.load / solid.ops.load.sum(axis=1, keepdims=True)
            self.element_nodes_mm = solid.mesh.nodes[elements][..., :2]
        self.field_place_mm = grid.strip.at_rest(np.array([[specimen.field_place_mm, 0.0]]))[0]
        self.magnet_face_mm = np.array(grid.face_mm)
        self.magnet_mass, self.magnet_centre_mm, self.magnet_dipole = 0.0, np.zeros(2), np.zeros(2)
        if magnet:
            volume = magnet.length_mm * magnet.width_mm * magnet.depth_mm
            around = prod(grid.block_mm) - volume  # silicone that is carried rigidly
            self.magnet_mass = (
                1e-9 * (volume * magnet.density_kg_m3 + around * specimen.density_kg_m3) * grid.per_specimen
            )
            self.magnet_centre_mm = _turned(np.array([0.5 * magnet.length_mm, 0.0]), grid.turn_rad)
            moment = 1e3 * magnet.moment_A_m2 * grid.per_specimen  # A m² = N m / T
            self.magnet_dipole = _turned(moment * np.array(magnet.direction), grid.turn_rad)

    def at_rest(self, straight_mm: Array) -> Array:
        """Map a point (x, y) of the straight reference beam to the unloaded specimen."""
        return self._grid.strip.at_rest(straight_mm[None])[0]

    @property
    def has_pressure_face(self) -> bool:
        """Whether the specimen has a face on which a pressure can act."""
        return self._solid.face is not None

    @property
    def is_solid(self) -> bool:
        """Whether the mesh is three-dimensional; False for a planar mesh."""
        return self._dimensions == 3

    def apply_force(self, force: Array, point_mm: Array, total: SolidLoads) -> None:
        """Add a force with constant direction and size to the sum of all loads, in place."""
        # ``force``: the force (x, y) in N on the simulated part of the specimen. ``point_mm``: its point (x, y) at
        # rest.
        straight = self._grid.straightened(point_mm)
        if self._grid.on_magnet(straight)[0]:
            total.force[:] += force
            total.tensor[:] += np.outer(force, point_mm - np.array(self._grid.face_mm))
        else:
            nodes, weights = self._grid.through_depth(straight[0])
            shares = np.zeros((len(self.nodal_mass), 2))
            np.add.at(shares, nodes, weights[..., None] * force)
            total.nodal[..., :2] += shares

    def loads(self, actuations: tuple[Actuation, ...], numbers: Array, field_factor: Array) -> SolidLoads:
        """Return the sum of all kinds of load in one load state."""
        # ``numbers`` (m,): the components of all kinds of load. ``field_factor`` (B,): factor on magnetic loads for
        # each of B candidate laws.
        batch = len(field_factor)
        total = SolidLoads(
            nodal=np.zeros((batch, len(self.nodal_mass), self._dimensions)),
            force=np.zeros((batch, 2)),
            tensor=np.zeros((batch, 2, 2)),
            pressure=np.zeros(batch),
            moment=np.zeros(batch),
        )
        first = 0
        for actuation in actuations:
            count = actuation.numbers.shape[1]
            of_actuation = numbers[first : first + count]
            if of_actuation.any():
                actuation.apply(of_actuation, field_factor, self, total)
            first += count
        body = self._solid.body
        if body:  # The nodes that the body carries pass their loads on to it.
            carried = total.nodal[:, body.nodes, :2]
            total.force[:] += carried.sum(axis=1)
            total.tensor[:] += np.einsum("bni,nj->bij", carried, body.arms)
        return total
