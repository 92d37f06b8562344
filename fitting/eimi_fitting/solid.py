"""Equilibrium of a planar solid for a batch of candidates: Newton's method with predicted stresses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from eimi_fitting import element
from eimi_fitting.element import Batch
from eimi_fitting.mesh import Indices, Mesh
from eimi_fitting.pressure import FollowerPressure
from eimi_fitting.rigid import RigidBody, dead_moment
from eimi_fitting.system import System

Array = NDArray[np.float64]


class Status(IntEnum):
    """What became of one candidate in one state."""

    CONVERGED = 0
    DIVERGED = 1
    OUT_OF_ITERATIONS = 2
    UNSTABLE = 3  # in equilibrium, but the law is not Drucker-stable over the stretches reached


@dataclass(frozen=True)
class SolidLoads:
    """Loads per mm of depth, one row a candidate or one for all: forces that keep their direction, and a pressure.

    nodal: (B, N, 2) N/mm on the nodes; force: (B, 2) N/mm and tensor: (B, 2, 2) N on the rigid body, whose potential
    is -force . U - tensor : R; pressure: (B,) N/mm² on the solid's face.
    """

    nodal: Array
    force: Array
    tensor: Array
    pressure: Array


@dataclass(frozen=True)
class Configuration:
    """Where a batch of candidates stands; every array is linear in what Newton solves for, so states extrapolate.

    displacement: (B, N, 2) mm; rigid: (B, 3) translation in mm and rotation in rad of the rigid body;
    pressure: (E, B, 3); stress: (3, E, B, q), the stress that the next tangent uses.
    """

    displacement: Array
    rigid: Array
    pressure: Array
    stress: Array

    def take(self, rows: Indices) -> Configuration:
        """The candidates ``rows`` alone."""
        return Configuration(self.displacement[rows], self.rigid[rows], self.pressure[:, rows], self.stress[:, :, rows])

    def put(self, rows: Indices, other: Configuration) -> None:
        """Overwrite the candidates ``rows``."""
        self.displacement[rows] = other.displacement
        self.rigid[rows] = other.rigid
        self.pressure[:, rows] = other.pressure
        self.stress[:, :, rows] = other.stress

    def copy(self) -> Configuration:
        """An independent copy."""
        return Configuration(self.displacement.copy(), self.rigid.copy(), self.pressure.copy(), self.stress.copy())


def combine(weights: Sequence[float], configurations: Sequence[Configuration]) -> Configuration:
    """Sum of configurations with the given weights: polynomial extrapolation over load steps."""

    def total(name: str) -> Array:
        result = weights[0] * getattr(configurations[0], name)
        for w, c in zip(weights[1:], configurations[1:], strict=True):
            result += w * getattr(c, name)
        return np.asarray(result)

    return Configuration(total("displacement"), total("rigid"), total("pressure"), total("stress"))


@dataclass(frozen=True)
class _Step:
    """One linear step: of the nodes (B, N, 2), of the rigid body (B, 3) and of the pressures; the predicted stress;
    which candidates could be solved.
    """

    nodal: Array
    rigid: Array
    pressure: Array
    stress: Array
    sound: NDArray[np.bool_]


class Solid:
    """A mesh and its supports: some displacements fixed at zero; perhaps a rigid body and a face under pressure.

    fixed: (N, 2) bool; rigid_nodes: nodes that move with a rigid body, whose reference point is ``rigid_centre`` (mm).
    """

    def __init__(
        self,
        mesh: Mesh,
        fixed: NDArray[np.bool_],
        rigid_nodes: Indices | None = None,
        rigid_centre: tuple[float, float] = (0.0, 0.0),
        face: FollowerPressure | None = None,
    ) -> None:
        self.mesh = mesh
        self.ops = element.operators(mesh)
        self.body = None if rigid_nodes is None else RigidBody(mesh, rigid_nodes, rigid_centre)
        self.face = face
        free = ~fixed
        if rigid_nodes is not None:
            free[rigid_nodes] = False
        self._free = np.flatnonzero(free.ravel())  # into (N, 2)
        number = np.full(free.size, -1, np.intp)
        number[self._free] = np.arange(len(self._free))
        dofs = number.reshape(-1, 2)[mesh.elements].transpose(0, 2, 1).reshape(-1, 18)
        self.system = System(dofs, len(self._free), None if self.body is None else self.body.elements)
        # Where the element arrays (E, ., 2, 9) find their values in (., N * 2).
        self._gather = (mesh.elements[:, None, :] * 2 + np.arange(2)[:, None]).reshape(-1)

    def rest(self, batch: int) -> Configuration:
        """The undeformed configuration for a batch."""
        n, e = len(self.mesh.nodes), len(self.mesh.elements)
        return Configuration(
            np.zeros((batch, n, 2)),
            np.zeros((batch, 3)),
            np.zeros((e, batch, 3)),
            np.zeros((3, e, batch, element.POINTS)),
        )

    def by_element(self, nodal: Array) -> Array:
        """(B, N, 2) -> (E, B, 2, 9)."""
        b, e = len(nodal), len(self.mesh.elements)
        gathered = nodal.reshape(b, 2 * len(self.mesh.nodes))[:, self._gather].reshape(b, e, 2, 9)
        return np.ascontiguousarray(gathered.transpose(1, 0, 2, 3))

    def _step(self, batch: Batch, loads: SolidLoads, now: Configuration) -> _Step:
        ops, body = self.ops, self.body
        b, n = len(now.displacement), len(self.mesh.elements)
        nodal = self.by_element(now.displacement)
        ev = element.evaluate(ops, batch, nodal, now.pressure)
        K = element.stiffness(ops, ev, now.stress)
        force = ev.force.reshape(n, b, 18)
        symmetric = True
        if self.face is not None and np.any(loads.pressure):
            force, symmetric = force.copy(), False
            self.face.press(loads.pressure, nodal.reshape(n, b, 18), force, K)
        effective = force
        incompressible = batch.section == "plane-strain"
        if incompressible:
            coupling, gap = element.volume_coupling(ops, ev), element.volume_gap(ops, batch, ev, now.pressure)
            modulus = batch.bulk[:, None] / ops.mass[:, None, :]  # (E, B, 3)
            scaled = coupling * modulus[:, :, None, :]
            K += np.matmul(scaled, coupling.swapaxes(-1, -2))
            effective = force + np.matmul(scaled, gap[..., None])[..., 0]
        right = loads.nodal.reshape(len(loads.nodal), -1)[:, self._free]
        tied = None
        if body:
            tie = body.matrix(now.rigid)
            moment, turning = dead_moment(loads.tensor, now.rigid)
            pull = np.empty((b, 3))
            pull[:, :2], pull[:, 2] = loads.force, moment
            tied = tie, turning + body.stiffness_of_turning(force, now.rigid), pull
        x, rigid, sound = self.system.solve(K, effective, right, tied, ev.valid, symmetric)
        flat = np.zeros((b, 2 * len(self.mesh.nodes)))
        flat[:, self._free] = x
        step = flat.reshape(now.displacement.shape)
        element_step = self.by_element(step).reshape(n, b, 18)
        if body:
            element_step[body.elements] += np.matmul(tie, rigid[..., None])[..., 0]
        pressure = np.zeros_like(now.pressure)
        if incompressible:
            pressure = modulus * (gap + np.matmul(coupling.swapaxes(-1, -2), element_step[..., None])[..., 0])
        stress = element.predict_stress(ops, ev, element_step.reshape(ev.force.shape), pressure)
        return _Step(step, rigid, pressure, stress, sound)

    def _moved(self, now: Configuration, step: _Step) -> tuple[Configuration, Array]:
        """The configuration after a step, and the largest displacement of any node (B,)."""
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
        most_iterations: int = 25,
    ) -> tuple[Configuration, NDArray[np.int8], NDArray[np.intp]]:
        """Newton from ``start`` until no node moves by ``tolerance_mm`` in a step.

        Returns the configuration, a Status (B,) and the number of tangents (B,). A candidate that fails keeps the
        place where it stood when it failed; it never touches another.
        """
        size = float(np.ptp(self.mesh.nodes, axis=0).max())
        now = start.copy()
        if self.body:
            self.body.carry(now.displacement, now.rigid)
        b = len(now.rigid)
        status = np.full(b, Status.OUT_OF_ITERATIONS, np.int8)
        iterations = np.zeros(b, np.intp)
        rows = np.arange(b)
        for _ in range(most_iterations):
            if not len(rows):
                break
            everyone = len(rows) == b
            part = now if everyone else now.take(rows)
            own = batch if everyone else _rows_of_batch(batch, rows)
            step = self._step(own, loads if everyone else _rows_of_loads(loads, rows), part)
            iterations[rows] += 1
            moved, largest = self._moved(part, step)
            ok = step.sound & (largest < 10 * size)
            if everyone and ok.all():
                now = moved
            else:
                keep = np.flatnonzero(ok)
                now.put(rows[keep], moved.take(keep))
            done = ok & (largest < tolerance_mm)
            status[rows[~ok]] = Status.DIVERGED
            status[rows[done]] = Status.CONVERGED
            rows = rows[ok & ~done]
        return now, status, iterations


def _rows_of_batch(batch: Batch, rows: Indices) -> Batch:
    return Batch(batch.law, batch.parameters[rows], batch.section, batch.bulk[rows])


def _rows_of_loads(loads: SolidLoads, rows: Indices) -> SolidLoads:
    if len(loads.force) == 1:
        return loads
    return SolidLoads(loads.nodal[rows], loads.force[rows], loads.tensor[rows], loads.pressure[rows])
