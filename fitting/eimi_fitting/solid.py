"""Equilibrium of a planar solid for a batch of candidates: Newton's method with predicted stresses."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from eimi_fitting import element
from eimi_fitting.band import BandAssembly, solve
from eimi_fitting.element import Batch
from eimi_fitting.mesh import Indices, Mesh

Array = NDArray[np.float64]


class Status(IntEnum):
    """What became of one candidate in one state."""

    CONVERGED = 0
    DIVERGED = 1
    OUT_OF_ITERATIONS = 2


@dataclass(frozen=True)
class DeadLoads:
    """Forces that keep their direction, per mm of depth, one row a candidate (or one row for all).

    nodal: (B, N, 2) N/mm on the nodes; force: (B, 2) N/mm and tensor: (B, 2, 2) N on the rigid end, whose potential
    is -force . U - tensor : R.
    """

    nodal: Array
    force: Array
    tensor: Array


@dataclass(frozen=True)
class Configuration:
    """Where a batch of candidates stands; every array is linear in what Newton solves for, so states extrapolate.

    displacement: (B, N, 2) mm; rigid: (B, 3) translation in mm and rotation in rad of the rigid end;
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


def combine(weights: Array, configurations: list[Configuration]) -> Configuration:
    """Sum of configurations with the given weights: polynomial extrapolation over load steps."""

    def total(name: str) -> Array:
        return np.asarray(sum(w * getattr(c, name) for w, c in zip(weights, configurations, strict=True)))

    return Configuration(total("displacement"), total("rigid"), total("pressure"), total("stress"))


class Solid:
    """A mesh, its section and its supports: some displacements fixed at zero, perhaps a rigid end.

    fixed: (N, 2) bool; rigid_nodes: nodes of the last column that move with a rigid body, whose reference point is
    ``rigid_centre`` (mm).
    """

    def __init__(
        self,
        mesh: Mesh,
        fixed: NDArray[np.bool_],
        rigid_nodes: Indices | None = None,
        rigid_centre: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self.mesh = mesh
        self.ops = element.operators(mesh)
        self.rigid_nodes = np.zeros(0, np.intp) if rigid_nodes is None else rigid_nodes
        self.arms = mesh.nodes[self.rigid_nodes] - np.asarray(rigid_centre)
        tied = np.zeros(len(mesh.nodes), bool)
        tied[self.rigid_nodes] = True
        self._free = ~fixed & ~tied[:, None]
        number = np.full((len(mesh.nodes), 2), -1, np.intp)
        number[self._free] = np.arange(self._free.sum())
        self.unknowns = int(self._free.sum()) + (3 if len(self.rigid_nodes) else 0)
        self._number = number
        dofs = number[mesh.elements].transpose(0, 2, 1).copy()  # (E, 2, 9)
        self._tied_elements = np.flatnonzero(tied[mesh.elements].any(axis=1))
        self._tied_local = tied[mesh.elements[self._tied_elements]]  # (Et, 9)
        # A tied element has three tied nodes; the rigid end's three unknowns take the places of their x components.
        shape = (len(self._tied_elements), 2, 9, 2, 9)
        constant, cosine, sine = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        for k, (e, local) in enumerate(zip(self._tied_elements, self._tied_local, strict=True)):
            free, bound = np.flatnonzero(~local), np.flatnonzero(local)
            dofs[e, 0, bound] = self.unknowns - 3 + np.arange(3)
            x, y = (mesh.nodes[mesh.elements[e, bound]] - np.asarray(rigid_centre)).T
            for i in range(2):
                constant[k, i, free, i, free] = 1.0
                constant[k, i, bound, 0, bound[i]] = 1.0
            cosine[k, 0, bound, 0, bound[2]], cosine[k, 1, bound, 0, bound[2]] = -y, x
            sine[k, 0, bound, 0, bound[2]], sine[k, 1, bound, 0, bound[2]] = -x, -y
        self._tie_constant, self._tie_cosine, self._tie_sine = (
            part.reshape(-1, 18, 18) for part in (constant, cosine, sine)
        )
        self.assembly = BandAssembly(dofs.reshape(-1, 18), self.unknowns)

    def rest(self, batch: int) -> Configuration:
        """The undeformed configuration for a batch."""
        n, e = len(self.mesh.nodes), len(self.mesh.elements)
        return Configuration(
            np.zeros((batch, n, 2)),
            np.zeros((batch, 3)),
            np.zeros((e, batch, 3)),
            np.zeros((3, e, batch, element.POINTS)),
        )

    def _tie(self, displacement: Array, rigid: Array) -> None:
        """Put the tied nodes where the rigid end carries them."""
        if not len(self.rigid_nodes):
            return
        c, s = np.cos(rigid[:, 2])[:, None], np.sin(rigid[:, 2])[:, None]
        x, y = self.arms.T
        displacement[:, self.rigid_nodes, 0] = rigid[:, 0:1] + (c - 1) * x - s * y
        displacement[:, self.rigid_nodes, 1] = rigid[:, 1:2] + s * x + (c - 1) * y

    def _tie_matrix(self, rigid: Array) -> Array:
        """(Et, B, 18, 18): local displacements of the tied elements from their unknowns."""
        b = len(rigid)
        c, s = np.cos(rigid[:, 2])[:, None, None], np.sin(rigid[:, 2])[:, None, None]
        t = np.repeat(self._tie_constant[:, None], b, axis=1)
        # The rotation's column: dR/dtheta times the arm.
        t += self._tie_cosine[:, None] * c + self._tie_sine[:, None] * s
        return t

    def _linear_step(
        self, batch: Batch, loads: DeadLoads, now: Configuration
    ) -> tuple[Array, Array, Array, Array, NDArray[np.bool_]]:
        """One linear solve: element steps, nodal step, rigid step, pressure step and which candidates are sound."""
        ops, mesh = self.ops, self.mesh
        n, b = len(mesh.elements), len(now.rigid)
        nodal = now.displacement[:, mesh.elements].transpose(1, 0, 3, 2)  # (E, B, 2, 9)
        ev = element.evaluate(ops, batch, np.ascontiguousarray(nodal), now.pressure)
        K = element.stiffness(ops, ev, now.stress)
        force = ev.force.reshape(n, b, 18)
        incompressible = batch.section == "plane-strain"
        if incompressible:
            coupling, gap = element.volume_terms(ops, batch, ev, now.pressure)
            modulus = batch.bulk[:, None] / ops.mass[:, None, :]  # (E, B, 3)
            scaled = coupling * modulus[:, :, None, :]
            K += np.matmul(scaled, coupling.swapaxes(-1, -2))
            effective = force + np.matmul(scaled, gap[..., None])[..., 0]
        else:
            effective = force
        right_loads = np.zeros((b, self.unknowns))
        right_loads[:, : self._free.sum()] = loads.nodal[:, self._free]
        tie = None
        if len(self.rigid_nodes):
            tie = self._tie_matrix(now.rigid)
            t = self._tied_elements
            K[t] = np.matmul(tie.swapaxes(-1, -2), np.matmul(K[t], tie))
            c, s = np.cos(now.rigid[:, 2]), np.sin(now.rigid[:, 2])
            q = loads.tensor
            along = c * (q[:, 0, 0] + q[:, 1, 1]) + s * (q[:, 1, 0] - q[:, 0, 1])
            moment = -s * (q[:, 0, 0] + q[:, 1, 1]) + c * (q[:, 1, 0] - q[:, 0, 1])
            # The tied nodes' forces turn with the end: their share of the geometric stiffness.
            x, y = self.arms.T
            rx, ry = c[:, None] * x - s[:, None] * y, s[:, None] * x + c[:, None] * y
            forces = self._tied_forces(force)
            follow = -np.sum(forces[:, :, 0] * rx + forces[:, :, 1] * ry, axis=1)
            effective = effective.copy()
            effective[t] = np.matmul(tie.swapaxes(-1, -2), effective[t][..., None])[..., 0]
            right_loads[:, -3:-1] = loads.force
            right_loads[:, -1] = moment
        band = self.assembly.matrix(K)
        if tie is not None:
            band[:, -1, 0] += along + follow
        x_step, ok = solve(band, right_loads - self.assembly.vector(effective))
        ok &= ev.valid
        x_step = np.where(ok[:, None], x_step, 0.0)
        step = np.zeros_like(now.displacement)
        step[:, self._free] = x_step[:, : self._free.sum()]
        rigid_step = x_step[:, -3:] if tie is not None else np.zeros((b, 3))
        element_step = np.ascontiguousarray(step[:, mesh.elements].transpose(1, 0, 3, 2)).reshape(n, b, 18)
        if tie is not None:
            t = self._tied_elements
            local = element_step[t].reshape(len(t), b, 2, 9)
            for k, tied in enumerate(self._tied_local):
                local[k][:, 0, tied] = rigid_step
                local[k][:, 1, tied] = 0.0
            element_step[t] = np.matmul(tie, local.reshape(len(t), b, 18, 1))[..., 0]
        if incompressible:
            pressure_step = modulus * (gap + np.matmul(coupling.swapaxes(-1, -2), element_step[..., None])[..., 0])
        else:
            pressure_step = np.zeros_like(now.pressure)
        stress = element.predict_stress(ops, ev, element_step.reshape(n, b, 2, 9), pressure_step)
        return step, rigid_step, pressure_step, stress, ok

    def _tied_forces(self, force: Array) -> Array:
        """Internal forces (B, T, 2) on the tied nodes from element forces (E, B, 18)."""
        b = force.shape[1]
        total = np.zeros((b, len(self.rigid_nodes), 2))
        place = {node: k for k, node in enumerate(self.rigid_nodes.tolist())}
        for e, local in zip(self._tied_elements, self._tied_local, strict=True):
            where = [place[node] for node in self.mesh.elements[e, local].tolist()]
            total[:, where] += force[e].reshape(b, 2, 9)[:, :, local].transpose(0, 2, 1)
        return total

    def equilibrium(
        self,
        batch: Batch,
        loads: DeadLoads,
        start: Configuration,
        tolerance_mm: float,
        most_iterations: int = 25,
    ) -> tuple[Configuration, NDArray[np.int8], NDArray[np.intp]]:
        """Newton from ``start`` until the largest displacement step is below ``tolerance_mm``.

        Returns the configuration, a Status (B,) and the number of linear solves (B,). A candidate that fails keeps
        the place where it stood when it failed; it never touches another.
        """
        size = float(np.ptp(self.mesh.nodes, axis=0).max())
        now = start.copy()
        self._tie(now.displacement, now.rigid)
        b = len(now.rigid)
        status = np.full(b, Status.OUT_OF_ITERATIONS, np.int8)
        iterations = np.zeros(b, np.intp)
        rows = np.arange(b)
        for _ in range(most_iterations):
            part = now.take(rows)
            step, rigid_step, pressure_step, stress, ok = self._linear_step(
                _rows_of_batch(batch, rows), _rows_of_loads(loads, rows), part
            )
            iterations[rows] += 1
            before = part.displacement[:, self.rigid_nodes]
            displacement, rigid = part.displacement + step, part.rigid + rigid_step
            self._tie(displacement, rigid)
            largest = np.abs(step).max(axis=(1, 2))
            if len(self.rigid_nodes):
                moved = np.abs(displacement[:, self.rigid_nodes] - before).max(axis=(1, 2))
                largest = np.maximum(largest, moved)
            ok &= largest < 10 * size
            keep = np.flatnonzero(ok)
            now.put(
                rows[keep],
                Configuration(displacement, rigid, part.pressure + pressure_step, stress).take(keep),
            )
            status[rows[~ok]] = Status.DIVERGED
            done = ok & (largest < tolerance_mm)
            status[rows[done]] = Status.CONVERGED
            rows = rows[ok & ~done]
            if not len(rows):
                break
        return now, status, iterations


def _rows_of_batch(batch: Batch, rows: Indices) -> Batch:
    return Batch(batch.law, batch.parameters[rows], batch.section, batch.bulk[rows])


def _rows_of_loads(loads: DeadLoads, rows: Indices) -> DeadLoads:
    def part(x: Array) -> Array:
        return np.broadcast_to(x[:1], (len(rows), *x.shape[1:])) if len(x) == 1 else x[rows]

    return DeadLoads(part(loads.nodal), part(loads.force), part(loads.tensor))
