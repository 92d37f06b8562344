"""Small vibrations of a beam about a static equilibrium, as sums of a few modes."""

# A vibration v exp(s t) with the shape v and the complex rate s satisfies (r(s) K_m + K_g + s² M) v = 0. K_m is the
# stiffness due to the tangent of the law, K_g the stiffness due to stresses and loads, M the mass matrix, and r the
# complex modulus divided by the static modulus.

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.equilibrium import Configuration, Solid, SolidLoads
from eimi_fitting.beam.inertia import MM_PER_M, Inertia
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.modal_motion import ReducedMotion
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.path import Candidates, candidates
from eimi_fitting.beam.rigid import dead_moment
from eimi_fitting.beam.solid_model import SolidModel
from eimi_fitting.beam.system import FactoredSystem
from eimi_fitting.laws.law import Law

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_SHAPES = 8  # in the subspace iteration; the first four become accurate
_PASSES = 40
_SAME = 1e-9  # relative change of the wanted eigenvalues at which the iteration ends
_TOLERANCE_MM = 1e-5


class Vibration:
    """The small vibrations of a specimen about its equilibria, for any number of candidate laws.

    Raises
    ------
    ValueError
        The specimen has a face under pressure.
    """

    # B candidate laws; E elements with u displacements each, of which H are at the magnet; N nodes with n unknowns.

    def __init__(
        self, model: BeamModel | SolidModel, tip_mass_kg: float = 0.0, hangs_along: Array | None = None
    ) -> None:
        # ``tip_mass_kg``: a point mass at the point where a tip force acts. ``hangs_along`` (2,): direction (unit
        # vector) of a thread on which the point mass hangs; None if it is fixed to the beam.
        if model.specimen.pressure_face is not None:
            raise ValueError(
                "the specimen has a pressure_face, but vibrations under a pressure are not computed: leave out "
                "pressure_face"
            )
        self.model = model
        self.inertia = Inertia(model, tip_mass_kg)
        self._solid = model.solid
        # A point mass on the magnet is part of the rigid body, and a thread has no effect on it.
        self._moves_along = np.eye(2) if hangs_along is None else np.outer(hangs_along, hangs_along)

    def about(
        self,
        law: Law,
        parameters: Array,
        loads: Loads,
        *,
        field_factor: Array | None = None,
        basis: tuple[Array, Array] | None = None,
        shapes: int = 4,
        stiffenings: Sequence[float] = (1.0,),
    ) -> tuple[ReducedMotion, Configuration]:
        """Find the equilibria of a beam, and its stiffness and mass for small motions about them."""
        # ``law``: the hyperelastic law.
        # ``parameters`` (B, n): the n parameters of B candidate laws; moduli in Pa.
        # ``loads``: the loads in one load state.
        # ``field_factor`` (B,): factor on the magnetic loads.
        # ``basis``: displacements of N nodes, (m, N, d), and motion of the magnet, (m, 3), in each of m shapes of
        # motion. None: the shapes are undamped modes, computed for several ratios of the dynamic to the static modulus.
        # ``shapes``: number of undamped modes for each ratio.
        # ``stiffenings``: the ratios of the dynamic to the static modulus.
        section = self.model.plane if isinstance(self.model, BeamModel) else "solid"
        chosen = candidates(law, parameters, section, None, field_factor)
        equilibria = self.model.solve(law, parameters, loads, tolerance_mm=_TOLERANCE_MM, field_factor=field_factor)
        reduced = self.near(chosen, loads, equilibria.last, basis=basis, shapes=shapes, stiffenings=stiffenings)
        return replace(reduced, sound=reduced.sound & equilibria.converged), equilibria.last

    def near(
        self,
        chosen: Candidates,
        loads: Loads,
        now: Configuration,
        *,
        basis: tuple[Array, Array] | None = None,
        shapes: int = 4,
        stiffenings: Sequence[float] = (1.0,),
    ) -> ReducedMotion:
        """Return the stiffness and mass for small motions about given equilibria."""
        # The arguments are those of `about`; ``now``: the equilibria.
        b = len(now.rigid)
        batch, factor = chosen.take(np.arange(b))
        on_mesh = loads.on(self.model.loaded)(loads.state(0), factor)
        material, rest, tie, body_rest = _tangents(self._solid, batch, on_mesh, now)
        body = None if tie is None else (tie, body_rest)
        if basis is None:
            parts, sound = [], np.ones(b, bool)
            for stiffening in stiffenings:
                stiffness = stiffening * material + rest
                factored = FactoredSystem(self._solid.system, stiffness, body)
                parts.append([part[:shapes] for part in self._modes(factored, stiffness, tie, body_rest, now)])
                sound &= factored.sound
            free, rigid = (np.concatenate(same) for same in zip(*parts, strict=True))
        else:
            nodal, moved = basis
            flat = nodal.reshape(len(nodal), -1)[:, self._solid.free]
            free = np.repeat(flat[:, None], b, axis=1)
            rigid = np.repeat(moved[:, None], b, axis=1)
            sound = np.ones(b, bool)
        local = self._local(free, rigid, tie)
        spring = np.einsum("mbi,bij,nbj->bmn", rigid, body_rest, rigid)
        return ReducedMotion(
            _quadratic(local, material),
            _quadratic(local, rest) + spring,
            self._mass(local, free, rigid, now),
            self._nodal(free, rigid, now),
            rigid,
            sound,
        )

    def _modes(
        self, factored: FactoredSystem, stiffness: Array, tie: Array | None, body_rest: Array, now: Configuration
    ) -> tuple[Array, Array]:
        """Return the lowest undamped modes of all candidate laws, scaled to unit mass."""
        # The results: the nodes (m, B, n) and the magnet (m, B, 3) in m modes. ``stiffness``: (E, B, u, u). ``tie`` (H,
        # B, u, 3): derivatives of the displacements of the elements at the magnet with respect to its motion.
        b, places = len(now.rigid), self.model.mesh.nodes
        along = 2 * places[:, 0] / np.ptp(places[:, 0]) - 1
        across = _SHAPES - 2
        start = np.zeros((_SHAPES, *places.shape))
        start[:across, :, 1] = np.polynomial.chebyshev.chebvander(along, across - 1).T
        start[across:, :, 0] = np.polynomial.chebyshev.chebvander(along, 1).T
        weighted = (start * self.model.loaded.nodal_mass[:, None]).reshape(_SHAPES, -1)[:, self._solid.free]
        nodes = np.repeat(weighted[:, None], b, axis=1)
        body = np.zeros((_SHAPES, b, 3))
        body[:across, :, 1] = body[across:, :, 0] = self.inertia.body_mass * MM_PER_M
        previous = np.full((b, 3), np.inf)
        # Subspace iteration (Bathe 2014, Finite Element Procedures, section 11.6).
        for _ in range(_PASSES):
            free, rigid = factored.solve(nodes, body)
            local = self._local(free, rigid, tie)
            stiff = _quadratic(local, stiffness) + np.einsum("mbi,bij,nbj->bmn", rigid, body_rest, rigid)
            mass = self._mass(local, free, rigid, now)
            scale = 1 / np.sqrt(np.einsum("bmm->bm", mass))
            values, vectors = _symmetric_modes(
                stiff * scale[:, :, None] * scale[:, None, :], mass * scale[:, :, None] * scale[:, None, :]
            )
            vectors = vectors * scale[:, :, None]
            free, rigid = (np.einsum("mbi,bmk->kbi", part, vectors) for part in (free, rigid))
            change = np.abs(values[:, :3] / previous - 1)
            previous = values[:, :3]
            if np.all(change[factored.sound] < _SAME):
                break
            nodes, body = self._times_mass(free, rigid, tie, now)
        return free, rigid

    def _local(self, free: Array, rigid: Array, tie: Array | None) -> Array:
        """Return the displacements of the finite elements in each of several modes."""
        # ``free`` (m, B, n), ``rigid`` (m, B, 3): the nodes and the magnet in m shapes. ``tie``: as in `_modes`. The
        # result is (m, E, B, u) in mm.
        solid = self._solid
        m, b = free.shape[:2]
        flat = np.zeros((m * b, solid.mesh.nodes.size))
        flat[:, solid.free] = free.reshape(m * b, -1)
        of_elements = solid.by_element(flat.reshape(m * b, *solid.mesh.nodes.shape))
        local = of_elements.reshape(len(of_elements), m, b, -1).swapaxes(0, 1)
        if tie is not None and solid.body:
            local = np.ascontiguousarray(local)
            local[:, solid.body.elements] += np.einsum("ebur,mbr->mebu", tie, rigid)
        return np.asarray(local)

    def _nodal(self, free: Array, rigid: Array, now: Configuration) -> Array:
        solid = self._solid
        m, b = free.shape[:2]
        flat = np.zeros((m, b, solid.mesh.nodes.size))
        flat[..., solid.free] = free
        nodal = flat.reshape(m, b, *solid.mesh.nodes.shape)
        if solid.body:
            c, s = np.cos(now.rigid[:, 2])[:, None], np.sin(now.rigid[:, 2])[:, None]
            x, y = solid.body.arms.T
            nodal[:, :, solid.body.nodes, 0] = rigid[..., 0:1] + (-s * x - c * y) * rigid[..., 2:3]
            nodal[:, :, solid.body.nodes, 1] = rigid[..., 1:2] + (c * x - s * y) * rigid[..., 2:3]
        return nodal

    def _mass(self, local: Array, free: Array, rigid: Array, now: Configuration) -> Array:
        # Return the mass matrix for sums of m shapes of motion, for each of B candidate laws.
        # ``local`` (m, E, B, u): displacements of the elements. ``free``, ``rigid``: as in `_local`. ``now``: the
        # equilibria. The result is (B, m, m).
        m, e, b, u = local.shape
        d = self._solid.dimensions
        by_direction = local.reshape(m, e, b, d, u // d)
        weighted = np.matmul(by_direction, self.inertia.of_elements[:, None])
        mass = np.einsum("mebu,nebu->bmn", local, weighted.reshape(local.shape), optimize=True)
        mass += np.einsum("mbi,bij,nbj->bmn", rigid, self.inertia.of_body(now.rigid[:, 2]), rigid)
        if self.inertia.point_mass:
            at_point = self._at_point(self._nodal(free, rigid, now))
            mass += self.inertia.point_mass * np.einsum("mbi,nbi->bmn", at_point, at_point)
        return np.asarray(mass)

    def _at_point(self, nodal: Array) -> Array:
        """Return the displacement (x, y) of the point mass in each shape of motion."""
        # ``nodal`` (m, B, N, d): displacements of the nodes. The result is (m, B, 2).
        return np.einsum("mbni,n,ij->mbj", nodal[..., :2], self.inertia.point_shares, self._moves_along)

    def _times_mass(self, free: Array, rigid: Array, tie: Array | None, now: Configuration) -> tuple[Array, Array]:
        """Multiply the mass matrix by the displacements of several modes."""
        # ``free``, ``rigid``: as in `_local`, and as the results. ``tie``: as in `_modes`.
        local = self._local(free, rigid, tie)
        m, e, b, u = local.shape
        d = self._solid.dimensions
        force = np.matmul(local.reshape(m, e, b, d, u // d), self.inertia.of_elements[:, None]).reshape(local.shape)
        joined = np.ascontiguousarray(force.swapaxes(0, 1).reshape(e, m * b, u))
        nodes = self._solid.system.assembled(joined).reshape(m, b, -1)
        body = np.einsum("bij,mbj->mbi", self.inertia.of_body(now.rigid[:, 2]), rigid)
        if tie is not None and self._solid.body:
            body = body + np.einsum("ebur,mebu->mbr", tie, force[:, self._solid.body.elements])
        if self.inertia.point_mass:
            at_point = self.inertia.point_mass * self._at_point(self._nodal(free, rigid, now))
            flat = np.zeros((m, b, *self._solid.mesh.nodes.shape))
            flat[..., :2] = at_point[:, :, None] * self.inertia.point_shares[:, None]
            nodes = nodes + flat.reshape(m, b, -1)[..., self._solid.free]
        return nodes, body


def _symmetric_modes(stiffness: Array, mass: Array) -> tuple[Array, Array]:
    """Return the eigenvalues and eigenvectors of a stiffness and a mass matrix."""
    # (B, m, m) gives (B, m) and (B, m, m).
    small = 1e-13 * np.eye(mass.shape[-1])
    factor = np.linalg.cholesky(mass + small)
    inverse = np.linalg.inv(factor)
    values, vectors = np.linalg.eigh(inverse @ stiffness @ inverse.swapaxes(-1, -2))
    return values, inverse.swapaxes(-1, -2) @ vectors


def _quadratic(local: Array, matrices: Array) -> Array:
    """Return the matrix of the whole mesh, such as the mass, in the coordinates of a few modes."""
    # ``local`` (m, E, B, u): displacements of the elements in each mode. ``matrices`` (E, B, u, u): those of the
    # elements. The result is (B, m, m).
    turned = np.ascontiguousarray(local.transpose(1, 2, 0, 3))  # (E, B, m, u)
    return np.asarray(np.matmul(np.matmul(turned, matrices), turned.swapaxes(-1, -2)).sum(axis=0))


def _tangents(
    solid: Solid, batch: Any, loads: SolidLoads, now: Configuration
) -> tuple[Array, Array, Array | None, Array]:
    """Return the stiffness against small motions about an equilibrium, in several parts."""
    # The results: ``material``, ``rest`` (E, B, u, u): the stiffness due to the tangent of the law, and that due
    # to stresses and loads.
    # ``tie`` (H, B, u, 3), or None: derivatives of the displacements of the elements at the magnet with respect to its
    # motion.
    # ``body_rest`` (B, 3, 3): the stiffness of the magnet due to the loads on it.
    kind, ops = solid.kind, solid.ops
    b, e = len(now.rigid), len(solid.mesh.elements)
    nodal = solid.by_element(now.displacement)
    ev = kind.evaluate(ops, batch, nodal, now.pressure)
    material = kind.stiffness(ops, ev, np.zeros_like(ev.S))
    rest = kind.stiffness(ops, ev, ev.S) - material
    force = ev.force.reshape(e, b, -1)
    if kind.mixed(batch):
        coupling = kind.volume_coupling(ops, ev)
        modulus = batch.bulk[:, None] / ops.mass[:, None, :]
        material += np.matmul(coupling * modulus[:, :, None, :], coupling.swapaxes(-1, -2))
    if loads.silicone_in_coil:
        of_field, field_stiffness = loads.silicone_in_coil.load(nodal)
        force = force - of_field.reshape(force.shape)
        rest += field_stiffness.reshape(rest.shape)
    body_rest = np.zeros((b, 3, 3))
    if not solid.body:
        return material, rest, None, body_rest
    tie = solid.body.matrix(now.rigid)
    _, turning = dead_moment(loads.tensor, now.rigid)
    body_rest[:, 2, 2] = turning + solid.body.stiffness_of_turning(force, now.rigid)
    if loads.in_coil:
        body_rest = body_rest + loads.in_coil.load(now.rigid)[1]
    return material, rest, tie, body_rest
