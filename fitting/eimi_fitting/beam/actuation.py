"""The interface of an actuation: one kind of load, with its values in every load state and its forces on a mesh.

A dead load is a force that keeps its direction and its size. A dead load f on a node with the displacement u has the
potential -f . u.

The magnet is a rigid body. Let U be the translation of its reference point, theta its rotation in rad, and R(theta) the
matrix of this rotation. Every dead load on the magnet has a potential of the form

    -F . U - Q : R(theta) - M theta,

with a force F (2,), a tensor Q (2, 2) and a moment M. Two examples, with ^T for the transpose: a dipole m in a uniform
field B has the energy -B . R m, so that F = 0, Q = B m^T and M = 0. A force f at the point s (a vector from the
reference point, at rest) has F = f, Q = f s^T and M = 0.
"""

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
    """One kind of load in K load states, described by m numbers in each state.

    Any class with these members can be added to `Loads`. The forces must be linear in the m numbers.
    """

    @property
    def numbers(self) -> Array:
        """Return the m numbers that describe the load in each of K load states, shape (K, m), in any unit."""
        ...

    def take(self, states: NDArray[np.intp]) -> Self:
        """Return the same kind of load in the load states with the given indices only, in the given order."""
        ...

    def apply(self, numbers: Array, field_factor: Array, mesh: LoadedMesh, total: SolidLoads) -> None:
        """Add the load of one load state to the sum of all loads.

        Parameters
        ----------
        numbers : ndarray, shape (m,)
            The m numbers that describe the load in this state.
        field_factor : ndarray, shape (B,)
            Factor on loads that a magnetic field causes, for each of B candidate laws.
        mesh : LoadedMesh
            The mesh with the integrals that are needed to compute forces. The mesh may be only a part of the specimen,
            for example half of its depth. ``mesh.share`` is the fraction of a load on the specimen that acts on the
            mesh.
        total : SolidLoads
            The sum of all loads, with one row for each candidate. This method adds to its arrays in place. A force on
            the whole specimen must first be multiplied by ``mesh.share``.
        """
        ...


class Places(Protocol):
    """The members of a mesh that are needed to compute loads, for example where the magnet is.

    The mesh is built in a reference beam: a straight beam of constant width, which ``strip`` maps to the specimen at
    rest.
    """

    specimen: Specimen
    strip: Strip
    straight_mm: Array
    block_mm: tuple[float, float, float]
    face_mm: tuple[float, float]
    turn_rad: float
    per_specimen: float

    def straightened(self, points_mm: Array) -> Array:
        """Map n points (x, y) of the specimen at rest to the reference beam, (n, 2) in mm.

        The reference beam is straight and has a constant width; the mesh is built in it. points_mm: the points at rest,
        (n, 2).
        """

    def on_magnet(self, points_mm: Array) -> NDArray[np.bool_]:
        """Return whether each of n points lies in the magnet or in silicone that moves rigidly with it, shape (n,).

        points_mm: coordinates (x, y) of the points in the reference beam, a straight beam of constant width, (n, 2).
        """

    def through_depth(self, point_mm: Array) -> tuple[Indices, Array]:
        """Return the nodes that share a force, and the fractions of the force on them, (m, n) each.

        The force is spread over m points through the depth; the element at each of these points has n nodes. point_mm:
        the point (x, y) of the force in the reference beam, a straight beam of constant width.
        """


def _turned(vector: Array, angle_rad: Array | float) -> Array:
    """Return a vector (x, y) rotated by one angle, shape (2,), or by each of n angles, shape (2, n)."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


class LoadedMesh:
    """The mesh of a specimen, with the integrals over the silicone and the magnet that are needed to compute loads.

    The mesh has N nodes with d coordinates, and E elements with n nodes each.

    Attributes
    ----------
    specimen : Specimen
        The specimen whose mesh this is.
    share : float
        The fraction of a load on the whole specimen that acts on the mesh. It is 1 / depth in 1/mm for a planar mesh,
        and 1/2 for a solid mesh, which covers half of the depth. Masses, forces and moments below contain this factor.
    nodal_mass : ndarray, shape (N,)
        Mass of the silicone at each node in kg (in kg per mm of depth for a planar mesh).
    slopes : ndarray, shape (N, d)
        The integral over the silicone of the derivatives of each node's shape function, in mm² (in mm for a planar
        mesh).
    nodal_dipole : ndarray, shape (N,)
        Factors d in N/T that give the forces of a uniform field B on magnetised silicone: the force on a node is d B.
        They are zero if the silicone is not magnetised.
    element_dipole : ndarray, shape (E, n)
        The contribution of each element to ``nodal_dipole``. This array and the next two exist only if the silicone is
        magnetised.
    element_share : ndarray, shape (E, n)
        Weights of an element's nodes. The weighted mean of the nodes' positions is the middle of the element.
    element_nodes_mm : ndarray, shape (E, n, 2)
        Positions (x, y) of the nodes of each element at rest.
    field_place_mm : ndarray, shape (2,)
        The point (x, y) of the specimen at rest at which the field is specified, if the field is not uniform.
    magnet_mass : float
        Mass of the rigid body, in the unit of ``nodal_mass``. The rigid body consists of the magnet and the silicone
        that moves rigidly with the magnet.
    magnet_face_mm : ndarray, shape (2,)
        The reference point of the rigid body at rest: the middle of the magnet's inner face.
    magnet_centre_mm : ndarray, shape (2,)
        The middle of the magnet at rest, as a vector (x, y) from the reference point. It is taken as the centre of mass
        of the rigid body.
    magnet_dipole : ndarray, shape (2,)
        Magnetic moment at rest in N mm/T.
    """

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
        """Map a point (x, y) of the reference beam to the specimen at rest, in mm.

        straight_mm: the point (x, y) in the reference beam, a straight beam of constant width in which the mesh is
        built.
        """
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
        """Add a dead force, which keeps its direction and size, to the sum of all loads.

        Parameters
        ----------
        force : ndarray, shape (2,)
            Force (x, y) in N on the mesh. A mesh that contains only a part of the specimen, such as half of its depth,
            carries this part (``share``) of the force on the specimen.
        point_mm : ndarray, shape (2,)
            Position (x, y) at rest of the material point on which the force acts.
        total : SolidLoads
            The sum of all loads, changed in place.
        """
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
        """Return the sum of all kinds of load (``actuations``, such as field and gravity) in one load state.

        Parameters
        ----------
        actuations : tuple of Actuation
            The kinds of load.
        numbers : ndarray, shape (m,)
            The components of all kinds of load in this state, one kind after another, as `Loads.state` returns them.
        field_factor : ndarray, shape (B,)
            Factor on magnetic loads for each of B candidate laws, or shape (1,) for all candidates.
        """
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
