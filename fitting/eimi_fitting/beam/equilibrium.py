"""Find the equilibrium of a planar or solid mesh for many candidate laws at once, by Newton's method.

The geometric part of the tangent stiffness is computed with the stress that the last linear step predicts (Magisano,
Leonetti, Garcea 2017, Int. J. Numer. Meth. Engng 109:1237).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam import brick, element
from eimi_fitting.beam.bricks import Bricks
from eimi_fitting.beam.coil_field import DipoleInField, SiliconeInField
from eimi_fitting.beam.element import Batch
from eimi_fitting.beam.mesh import Indices, Mesh
from eimi_fitting.beam.pressure import FollowerPressure
from eimi_fitting.beam.rigid import RigidBody, dead_moment
from eimi_fitting.beam.system import structure_of

Array = NDArray[np.float64]


_MOST_ITERATIONS = 25  # of Newton's method
_LOADS = ("nodal", "force", "tensor", "pressure", "moment")
_IN_COIL = ("in_coil", "silicone_in_coil")
_ELEMENTS_AT_ONCE = 4096  # of all candidates or states together, whose strains are computed at once


class Status(IntEnum):
    """The outcome of the computation of an equilibrium for one candidate law in one load state."""

    CONVERGED = 0
    DIVERGED = 1
    OUT_OF_ITERATIONS = 2
    UNSTABLE = 3  # in equilibrium, but the law is not Drucker-stable up to the stretches reached
    ASTRAY = 4  # in equilibrium, but perhaps not the one that the loads lead to
    BUCKLED = 5  # in an unstable equilibrium: the tangent is not positive definite


@dataclass
class SolidLoads:
    """Loads on the nodes of a mesh and on the rigid magnet in one load state."""

    # N nodes with d coordinates, and one row for each of B candidate laws or one row for all. Loads on a planar mesh
    # are per mm of depth.

    # (B, N, d): forces on the nodes in N.
    nodal: Array
    # `force`, `tensor`, `moment`: load on the rigid magnet in N, N mm and N mm. For the translation U and the matrix
    # R of the rotation theta, its potential is -force . U - tensor : R - moment theta.
    force: Array
    tensor: Array
    # (B,): pressure on the specimen's ``pressure_face`` in N/mm².
    pressure: Array
    moment: Array
    # The magnet in the non-uniform field of a coil.
    in_coil: DipoleInField | None = None
    # Magnetised silicone in the non-uniform field of a coil.
    silicone_in_coil: SiliconeInField | None = None


@dataclass(frozen=True)
class Configuration:
    """Displacements, motion of the rigid magnet, pressures and stresses of all candidate laws in one load state."""

    # B candidate laws, N nodes with d coordinates, and E elements with q Gauss points each.

    # (B, N, d): displacements of the nodes in mm.
    displacement: Array
    # (B, 3): translation (x, y) of the magnet in mm, and its rotation in rad.
    rigid: Array
    # (E, B, d + 1): coefficients of the pressure functions in N/mm².
    pressure: Array
    # (3 or 6, E, B, q): the stress in N/mm² at the Gauss points.
    stress: Array

    def take(self, rows: Indices) -> Configuration:
        """Return the configurations of the beam for some of the candidate laws only."""
        return Configuration(self.displacement[rows], self.rigid[rows], self.pressure[:, rows], self.stress[:, :, rows])

    def put(self, rows: Indices, other: Configuration) -> None:
        """Overwrite the configurations of the beam for some of the candidate laws."""
        self.displacement[rows] = other.displacement
        self.rigid[rows] = other.rigid
        self.pressure[:, rows] = other.pressure
        self.stress[:, :, rows] = other.stress

    def copy(self) -> Configuration:
        """Return a copy that shares no array with this configuration."""
        return Configuration(self.displacement.copy(), self.rigid.copy(), self.pressure.copy(), self.stress.copy())


def combine(weights: Sequence[float], configurations: Sequence[Configuration]) -> Configuration:
    """Return the weighted sum of configurations of one mesh."""

    def total(name: str) -> Array:
        result = weights[0] * getattr(configurations[0], name)
        for w, c in zip(weights[1:], configurations[1:], strict=True):
            result += w * getattr(c, name)
        return np.asarray(result)

    return Configuration(total("displacement"), total("rigid"), total("pressure"), total("stress"))


def joined(parts: Sequence[Configuration]) -> Configuration:
    """Concatenate several sets of configurations."""
    return Configuration(
        np.concatenate([part.displacement for part in parts]),
        np.concatenate([part.rigid for part in parts]),
        np.concatenate([part.pressure for part in parts], axis=1),
        np.concatenate([part.stress for part in parts], axis=2),
    )


def loads_joined(parts: Sequence[SolidLoads]) -> SolidLoads:
    """Concatenate several sets of loads, so that their equilibria can be computed together."""
    arrays: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in _LOADS}
    joined_loads = SolidLoads(**arrays)
    for name in _IN_COIL:
        if first := next((load for part in parts if (load := getattr(part, name))), None):
            of_parts = [getattr(part, name) for part in parts]
            fields = [
                load.field_T if load else np.zeros_like(part.force) for load, part in zip(of_parts, parts, strict=True)
            ]
            setattr(joined_loads, name, replace(first, field_T=np.concatenate(fields)))
    return joined_loads


@dataclass(frozen=True)
class _Step:
    """One linear step of Newton's method."""

    # (B, N, d): change of the displacements of N nodes with d coordinates in mm.
    nodal: Array
    # (B, 3): change of the magnet's translation (x, y) in mm and rotation in rad.
    rigid: Array
    # Change of the pressures, in the shape of ``Configuration.pressure``.
    pressure: Array
    # The stress after the step according to the linear system, in the shape of ``Configuration.stress``.
    stress: Array
    # (B,): whether the linear system could be solved.
    sound: NDArray[np.bool_]
    # (B,): whether the tangent stiffness is not positive definite.
    indefinite: NDArray[np.bool_]


class Solid:
    """The finite-element model of a beam, with its supports, its rigid magnet and a face under pressure."""

    def __init__(
        self,
        mesh: Mesh | Bricks,
        fixed: NDArray[np.bool_],
        rigid_nodes: Indices | None = None,
        rigid_centre: tuple[float, float] = (0.0, 0.0),
        face: FollowerPressure | None = None,
    ) -> None:
        # ``fixed`` (N, d): True for the displacements that are zero. ``rigid_nodes``: nodes of the rigid magnet.
        # ``rigid_centre``: reference point (x, y) of the magnet in mm. ``face``: the face under pressure.
        self.mesh = mesh
        self.dimensions = mesh.nodes.shape[1]
        self.ops: Any = self.kind.operators(mesh)
        self.body = None if rigid_nodes is None else RigidBody(mesh, rigid_nodes, rigid_centre)
        self.face = face
        free = ~fixed
        if rigid_nodes is not None:
            free[rigid_nodes] = False
        self.free = np.flatnonzero(free.ravel())  # places of the free unknowns in (N, d)
        number = np.full(free.size, -1, np.intp)
        number[self.free] = np.arange(len(self.free))
        d, self._unknowns = self.dimensions, self.dimensions * mesh.elements.shape[1]  # of an element
        dofs = number.reshape(-1, d)[mesh.elements].transpose(0, 2, 1).reshape(-1, self._unknowns)
        tied = None if self.body is None else self.body.elements
        self.system = structure_of(dofs, len(self.free), tied, self.kind.AT_ONCE)
        # Where the element arrays (E, ., d, nodes) find their values in (., N * d).
        self._gather = (mesh.elements[:, None, :] * d + np.arange(d)[:, None]).reshape(-1)

    @property
    def kind(self) -> Any:
        """The module with the functions of the element: `beam.element` or `beam.brick`."""
        return brick if isinstance(self.mesh, Bricks) else element

    def rest(self, batch: int) -> Configuration:
        """Return the undeformed configuration for a number of candidate laws."""
        n, e, d = len(self.mesh.nodes), len(self.mesh.elements), self.dimensions
        return Configuration(
            np.zeros((batch, n, d)),
            np.zeros((batch, 3)),
            np.zeros((e, batch, d + 1)),
            np.zeros((d * (d + 1) // 2, e, batch, self.kind.POINTS)),
        )

    def by_element(self, nodal: Array) -> Array:
        """Copy the values at the nodes of the mesh to the nodes of each element."""
        # (B, N, d) gives (E, B, d, n).
        b, e, d = len(nodal), len(self.mesh.elements), self.dimensions
        gathered = nodal.reshape(b, d * len(self.mesh.nodes))[:, self._gather].reshape(b, e, d, self._unknowns // d)
        return np.ascontiguousarray(gathered.transpose(1, 0, 2, 3))

    def stretch(self, displacement: Array) -> Array:
        """Return the largest principal stretch at all Gauss points."""
        # ``displacement`` (B, N, d): of the nodes in mm. The result is (E, B, q).
        b, most = len(displacement), max(_ELEMENTS_AT_ONCE // len(self.mesh.elements), 1)
        parts = [displacement[first : first + most] for first in range(0, max(b, 1), most)]
        return np.concatenate([self.kind.stretch(self.ops, self.by_element(part)) for part in parts], axis=1)

    def _step(self, batch: Batch, loads: SolidLoads, now: Configuration, only_definite: bool) -> _Step:
        ops, body, kind = self.ops, self.body, self.kind
        b, n = len(now.displacement), len(self.mesh.elements)
        nodal = self.by_element(now.displacement)
        ev = kind.evaluate(ops, batch, nodal, now.pressure)
        tangents: Iterator[Array] = kind.tangents(ops, ev, now.stress)
        force = ev.force.reshape(n, b, self._unknowns)
        symmetric = True
        if self.face is not None and np.any(loads.pressure):
            force, symmetric = force.copy(), False
            (K,) = tangents
            tangents = iter([K])
            self.face.press(loads.pressure, nodal.reshape(n, b, self._unknowns), force, K)
        if loads.silicone_in_coil:
            of_field, field_stiffness = loads.silicone_in_coil.load(nodal)
            force = force - of_field.reshape(force.shape)
            further = field_stiffness.reshape(n, b, self._unknowns, self._unknowns)
            tangents = _plus(tangents, lambda some: further[some])
        effective = force
        mixed = kind.mixed(batch)
        if mixed:
            coupling, gap = kind.volume_coupling(ops, ev), element.volume_gap(ops, batch, ev, now.pressure)
            modulus = batch.bulk[:, None] / ops.mass[:, None, :]  # (E, B, d + 1)
            scaled = coupling * modulus[:, :, None, :]
            tangents = _plus(tangents, lambda some: np.matmul(scaled[some], coupling[some].swapaxes(-1, -2)))
            effective = force + np.matmul(scaled, gap[..., None])[..., 0]
        right = loads.nodal.reshape(len(loads.nodal), -1)[:, self.free]
        tied = None
        if body:
            tie = body.matrix(now.rigid)
            moment, turning = dead_moment(loads.tensor, now.rigid)
            pull = np.empty((b, 3))
            pull[:, :2], pull[:, 2] = loads.force, moment + loads.moment
            stiffness = np.zeros((b, 3, 3))
            stiffness[:, 2, 2] = turning + body.stiffness_of_turning(force, now.rigid)
            if loads.in_coil:
                in_coil, stiffness_in_coil = loads.in_coil.load(now.rigid)
                pull, stiffness = pull + in_coil, stiffness + stiffness_in_coil
            tied = tie, stiffness, pull
        x, rigid, sound, indefinite = self.system.solve(
            tangents, effective, right, tied, ev.valid, symmetric, only_definite
        )
        flat = np.zeros((b, self.dimensions * len(self.mesh.nodes)))
        flat[:, self.free] = x
        step = flat.reshape(now.displacement.shape)
        element_step = self.by_element(step).reshape(n, b, self._unknowns)
        if body:
            element_step[body.elements] += np.matmul(tie, rigid[..., None])[..., 0]
        pressure = np.zeros_like(now.pressure)
        if mixed:
            pressure = modulus * (gap + np.matmul(coupling.swapaxes(-1, -2), element_step[..., None])[..., 0])
        stress = kind.predict_stress(ops, ev, element_step.reshape(ev.force.shape), pressure)
        return _Step(step, rigid, pressure, stress, sound, indefinite)

    def _moved(self, now: Configuration, step: _Step) -> tuple[Configuration, Array]:
        """Return the configurations after a Newton step, and the largest displacement in this step in mm."""
        displacement, rigid = now.displacement + step.nodal, now.rigid + step.rigid
        if self.body:
            self.body.carry(displacement, rigid)
        largest = np.abs(displacement - now.displacement).max(axis=(1, 2))
        return Configuration(displacement, rigid, now.pressure + step.pressure, step.stress), largest

    def equilibrium(
        self,
        batch: Batch,
        loads: SolidLoads,
        start: Configuration,
        tolerance_mm: float,
        few: int | None = None,
        only_try: bool = False,
    ) -> tuple[Configuration, NDArray[np.int8], NDArray[np.intp]]:
        """Find the equilibrium of all candidate laws by Newton's method, and check whether it is stable."""
        # ``batch``: the B candidate laws.
        # ``loads``: the loads on the mesh.
        # ``start``: the configuration at which Newton's method begins.
        # ``tolerance_mm``: largest displacement of a node in the last step.
        # ``few``: largest number of iterations; None: 25.
        # ``only_try``: give up a candidate as soon as the matrix to be factorised is not positive definite.
        # The results: the equilibrium, or the configuration at which the method failed; `Status` of each candidate,
        # (B,); number of tangent stiffnesses that were computed, (B,).
        size = float(np.ptp(self.mesh.nodes, axis=0).max())
        now = start.copy()
        if self.body:
            self.body.carry(now.displacement, now.rigid)
        b = len(now.rigid)
        status = np.full(b, Status.OUT_OF_ITERATIONS, np.int8)
        iterations = np.zeros(b, np.intp)
        rows = np.arange(b)
        for _ in range(few or _MOST_ITERATIONS):
            if not len(rows):
                break
            everyone = len(rows) == b
            part = now if everyone else now.take(rows)
            batch_part = batch if everyone else _rows_of_batch(batch, rows)
            step = self._step(batch_part, loads if everyone else _rows_of_loads(loads, rows), part, only_try)
            iterations[rows] += 1
            moved, largest = self._moved(part, step)
            ok = step.sound & (largest < 10 * size)
            if everyone and ok.all():
                now = moved
            else:
                keep = np.flatnonzero(ok)
                now.put(rows[keep], moved.take(keep))
                status[rows[~ok]] = Status.DIVERGED
            done = ok & (largest < tolerance_mm)
            status[rows[done]] = Status.CONVERGED
            status[rows[done & step.indefinite]] = Status.BUCKLED
            rows = rows[ok & ~done & ~(step.indefinite & (few is not None))]
        return now, status, iterations


def _plus(tangents: Iterator[Array], further: Callable[[slice], Array]) -> Iterator[Array]:
    """Add a further stiffness to the tangent stiffness of each group of elements."""
    # ``further`` returns this stiffness for the elements of a group.
    first = 0
    for K in tangents:
        some = slice(first, first + len(K))
        K += further(some)
        first = some.stop
        yield K


def _rows_of_batch(batch: Batch, rows: Indices) -> Batch:
    return Batch(batch.law, batch.parameters[rows], batch.section, batch.bulk[rows])


def _rows_of_loads(loads: SolidLoads, rows: Indices) -> SolidLoads:
    if len(loads.force) == 1:
        return loads
    of_rows: dict[str, Any] = {name: getattr(loads, name)[rows] for name in _LOADS}
    for name in _IN_COIL:
        load = getattr(loads, name)
        of_rows[name] = replace(load, field_T=load.field_T[rows]) if load else None
    return SolidLoads(**of_rows)
