"""The forward model: parameters in, the beam's shape in every state out, for a whole population at once."""

from __future__ import annotations

from dataclasses import dataclass
from math import prod

import numpy as np
from numpy.typing import NDArray

from eimi_fitting import element
from eimi_fitting.actuation import Loads
from eimi_fitting.element import Batch
from eimi_fitting.materials import Law
from eimi_fitting.mesh import Indices, beam_mesh, shape_functions
from eimi_fitting.solid import Configuration, DeadLoads, Solid, Status, combine
from eimi_fitting.specimen import Specimen
from eimi_fitting.stability import stable_stretch

Array = NDArray[np.float64]

BULK_RATIO = 1e4  # bulk over shear modulus of an incompressible material: changes the tip by less than 1e-4
# With these the tip of a slender beam on 13 x 1 elements is seven times nearer to the limit than with equal elements.
_FINER_AT_CLAMP, _FINER_AT_MAGNET = 10.0, 5.0
_MEGA = 1e-6  # Pa -> MPa = N/mm²


@dataclass(frozen=True)
class Shapes:
    """P candidates in K states.

    displacement: (P, K, N, 2) mm; rigid: (P, K, 3) mm, mm, rad (rotation of the magnet, zero without one);
    status: (P, K) Status; iterations: (P, K) tangents factorised; max_stretch: (P, K) largest principal stretch.
    Rows that are not converged hold the last place reached: look at the status.
    """

    displacement: Array
    rigid: Array
    status: NDArray[np.int8]
    iterations: NDArray[np.intp]
    max_stretch: Array
    last: Configuration

    @property
    def converged(self) -> NDArray[np.bool_]:
        """(P,) every state converged."""
        return np.asarray((self.status == Status.CONVERGED).all(axis=1))


class BeamModel:
    """A specimen's finite-element model: made once, solved for any number of candidates.

    along, across: elements of the flexible part, finer toward its two ends; across follows from the proportions
    unless given. The magnet is rigid, silicone beside it is carried along; the model works per unit depth of the
    specimen. Raises ValueError when the magnet leaves no flexible part.
    """

    def __init__(self, specimen: Specimen, along: int = 13, across: int | None = None) -> None:
        self.specimen = specimen
        flexible, width = specimen.flexible_length_mm, specimen.width_mm
        if flexible <= 0:
            raise ValueError(
                f"a {specimen.length_mm - flexible:g} mm magnet leaves nothing of a beam of {specimen.length_mm:g} mm"
            )
        if across is None:
            across = max(1, round(0.5 * along * width / flexible))
        finer_at_end = _FINER_AT_MAGNET if specimen.magnet else 0.0
        mesh = beam_mesh(flexible, width, along, across, _FINER_AT_CLAMP, finer_at_end)
        fixed = np.zeros((len(mesh.nodes), 2), bool)
        fixed[mesh.column(0)] = True
        rigid = mesh.column(-1) if specimen.magnet else None
        self.mesh = mesh
        self.along, self.across = along, across
        self.solid = Solid(mesh, fixed, rigid, (flexible, 0.0))
        self._lumped = np.zeros(len(mesh.nodes))
        np.add.at(self._lumped, mesh.elements, self.solid.ops.load)
        self._slopes = np.zeros((len(mesh.nodes), 2))  # integrals of dN/dX
        np.add.at(self._slopes, mesh.elements, self.solid.ops.slope)

    def refined(self) -> BeamModel:
        """The same specimen on a mesh twice as fine along and three times across.

        The modulus identified with 26 x 3 elements is within 0.07 % of the one with 80 x 10, with 13 x 1 within 0.4 %.
        """
        return BeamModel(self.specimen, 2 * self.along, 3 * self.across)

    def place(self, points_mm: Array) -> tuple[Indices, Array]:
        """Nodes (n, 9) and weights (n, 9) that give the displacement of material points (n, 2) of the flexible part.

        Raises ValueError for a point more than 1 µm outside it.
        """
        points = np.atleast_2d(np.asarray(points_mm, float))
        flexible, width = self.specimen.flexible_length_mm, self.specimen.width_mm
        ends = self.mesh.nodes[self.mesh.row(0)[::2], 0]
        s = np.interp(points[:, 0], ends, np.arange(self.along + 1))
        t = (points[:, 1] / width + 0.5) * self.across
        outside = (np.abs(points[:, 0] - 0.5 * flexible) > 0.5 * flexible + 1e-3) | (
            np.abs(points[:, 1]) > 0.5 * width + 1e-3
        )
        if outside.any():
            x, y = points[np.argmax(outside)]
            raise ValueError(
                f"point ({x:g}, {y:g}) mm is not in the flexible part (0..{flexible:g}, ±{width / 2:g} mm)"
            )
        i = np.clip(s.astype(int), 0, self.along - 1)
        j = np.clip(t.astype(int), 0, self.across - 1)
        values, _ = shape_functions(2 * (s - i) - 1, 2 * (t - j) - 1)
        return self.mesh.elements[i * self.across + j], values

    def positions(self, shapes: Shapes, points_mm: Array) -> Array:
        """(P, K, n, 2): where the material points (n, 2), given at rest, are in each state. Raises ValueError."""
        points = np.atleast_2d(np.asarray(points_mm, float))
        p, k = shapes.status.shape
        moved = np.empty((p, k, len(points), 2))
        on_magnet = points[:, 0] > self.specimen.flexible_length_mm + 1e-9
        if self.specimen.magnet is None:
            on_magnet[:] = False
        nodes, weights = self.place(points[~on_magnet])
        moved[:, :, ~on_magnet] = points[~on_magnet] + np.einsum(
            "pknai,na->pkni", shapes.displacement[:, :, nodes], weights
        )
        moved[:, :, on_magnet] = self.carried(shapes, points[on_magnet])
        return moved

    def carried(self, shapes: Shapes, points_mm: Array) -> Array:
        """(P, K, n, 2): where points (n, 2) of the rigid end are in each state."""
        arm = points_mm - np.array([self.specimen.flexible_length_mm, 0.0])
        c, s = np.cos(shapes.rigid[..., 2, None]), np.sin(shapes.rigid[..., 2, None])
        x = self.specimen.flexible_length_mm + shapes.rigid[..., 0, None] + c * arm[:, 0] - s * arm[:, 1]
        y = shapes.rigid[..., 1, None] + s * arm[:, 0] + c * arm[:, 1]
        return np.stack([x, y], axis=-1)

    def tip_angle_deg(self, shapes: Shapes) -> Array:
        """(P, K): rotation of the tip from rest, of the magnet or of the last column of nodes."""
        if self.specimen.magnet:
            return np.degrees(shapes.rigid[..., 2])
        ends = shapes.displacement[:, :, self.mesh.column(-1)[[0, -1]]]
        across = ends[:, :, 1] - ends[:, :, 0] + np.array([0.0, self.specimen.width_mm])
        return np.degrees(np.arctan2(-across[..., 0], across[..., 1]))

    def _dead_loads(self, load: Array) -> DeadLoads:
        """One state's loads (6,), see Loads.state, per mm of depth."""
        spec, magnet = self.specimen, self.specimen.magnet
        field, gravity, tip_force = load[0:2], load[2:4], load[4:6]
        kg_per_mm3 = 1e-9 * spec.density_kg_m3
        nodal = self._lumped[:, None] * (kg_per_mm3 * gravity)
        # Hard-magnetic silicone: the energy -B . F M is linear in the displacement, so its forces are dead
        # (Zhao, Kim, Cianchetti, Zhao 2019, J. Mech. Phys. Solids 124:244). A/m T = J/m³ = 1e-6 N/mm².
        nodal = nodal + 1e-6 * (self._slopes @ np.array(spec.magnetisation_A_per_m))[:, None] * field
        force, tensor = np.zeros(2), np.zeros((2, 2))
        point = np.array(spec.tip_load_mm if spec.tip_load_mm is not None else (spec.length_mm, 0.0))
        per_depth = tip_force / spec.depth_mm
        if magnet:
            centre = np.array([0.5 * magnet.length_mm, 0.0])  # of the rigid block, from its inner face
            block = magnet.length_mm * spec.width_mm * spec.depth_mm
            body = magnet.length_mm * magnet.width_mm * magnet.depth_mm
            mass = 1e-9 * (body * magnet.density_kg_m3 + (block - body) * spec.density_kg_m3) / spec.depth_mm
            force = mass * gravity
            tensor = np.outer(force, centre)
            moment = 1e3 * magnet.moment_A_m2 / spec.depth_mm  # A m² = N m / T -> N mm / T, per mm
            tensor = tensor + np.outer(field, [moment, 0.0])
        if np.any(tip_force):
            if magnet and point[0] >= spec.flexible_length_mm:
                force = force + per_depth
                tensor = tensor + np.outer(per_depth, point - [spec.flexible_length_mm, 0.0])
            else:
                nodes, weights = self.place(point)
                np.add.at(nodal, nodes[0], weights[0][:, None] * per_depth)
        return DeadLoads(nodal[None], force[None], tensor[None])

    def solve(
        self,
        law: Law,
        parameters: Array,
        loads: Loads,
        *,
        tolerance_mm: float = 1e-6,
        start: Configuration | None = None,
        bulk_modulus_Pa: Array | None = None,
    ) -> Shapes:
        """Take P candidates, parameters (P, n) in the law's units (Pa), through the K states in order.

        The first state is reached from rest (or from ``start``, the ``last`` of an earlier result), each further one
        by extrapolation from those before. A step that fails is cut into smaller ones; a candidate that fails for
        good is marked in this and in all later states, and no longer computed. The material is incompressible unless
        bulk moduli (P,) are given, which plane stress does not know: ValueError.
        """
        parameters = np.atleast_2d(np.asarray(parameters, float))
        scale = np.array([_MEGA if unit == "Pa" else 1.0 for unit in law.units])
        sound = np.asarray(np.isfinite(parameters).all(axis=1))
        scaled = np.where(sound[:, None], parameters, 1.0) * scale
        with np.errstate(all="ignore"):
            mu = law.initial_shear_modulus(scaled)
        sound = sound & np.isfinite(mu) & (mu > 0)
        section = self.specimen.section
        bulk = BULK_RATIO * np.where(sound, mu, 1.0)
        if bulk_modulus_Pa is not None:
            if section == "plane-stress":
                raise ValueError("plane stress is incompressible here: it takes no bulk modulus")
            given = np.broadcast_to(np.asarray(bulk_modulus_Pa, float) * _MEGA, bulk.shape)
            sound = sound & np.isfinite(given) & (given > 0)
            bulk = np.where(sound, given, bulk)
        batch = Batch(law, scaled, section, bulk)
        p, k_states = len(parameters), len(loads)
        now = self.solid.rest(p) if start is None else start.copy()
        shapes = Shapes(
            np.zeros((p, k_states, len(self.mesh.nodes), 2)),
            np.zeros((p, k_states, 3)),
            np.full((p, k_states), Status.DIVERGED, np.int8),
            np.zeros((p, k_states), np.intp),
            np.ones((p, k_states)),
            now,
        )
        rows = np.flatnonzero(sound)
        path: list[tuple[Array, Configuration]] = []
        previous = np.zeros(6)
        for k in range(k_states):
            load = loads.state(k)
            with np.errstate(all="ignore"):
                guess = _extrapolate(path, load) or now.copy()
                status, iterations = self._advance(batch, rows, previous, load, guess, now, tolerance_mm)
            shapes.displacement[:, k] = now.displacement
            shapes.rigid[:, k] = now.rigid
            shapes.status[rows, k] = status
            shapes.iterations[rows, k] = iterations
            rows = rows[status == Status.CONVERGED]
            shapes.max_stretch[rows, k] = self._stretch(now.displacement[rows]).max(axis=(0, 2))
            path.append((load, now.copy()))
            previous = load
        limit = stable_stretch(law, scaled, shapes.max_stretch.max(axis=1))
        beyond = shapes.max_stretch > limit[:, None] * (1 + 1e-9)
        shapes.status[(shapes.status == Status.CONVERGED) & beyond] = Status.UNSTABLE
        return shapes

    def _advance(
        self,
        batch: Batch,
        rows: Indices,
        previous: Array,
        load: Array,
        guess: Configuration,
        now: Configuration,
        tolerance_mm: float,
    ) -> tuple[NDArray[np.int8], NDArray[np.intp]]:
        """Bring ``rows`` of ``now`` to the new load, in one step or, where that fails, in 4 and then in 16."""
        status = np.full(len(rows), Status.DIVERGED, np.int8)
        iterations = np.zeros(len(rows), np.intp)
        left = np.arange(len(rows))  # places in ``rows`` that have not arrived
        for cuts in (1, 4, 16):
            part = (guess if cuts == 1 else now).take(rows[left])
            going = left.copy()
            for c in range(1, cuts + 1):
                dead = self._dead_loads(previous + (load - previous) * c / cuts)
                sub = Batch(batch.law, batch.parameters[rows[going]], batch.section, batch.bulk[rows[going]])
                part, outcome, spent = self.solid.equilibrium(sub, dead, part, tolerance_mm)
                iterations[going] += spent
                status[going] = outcome
                fine = np.flatnonzero(outcome == Status.CONVERGED)
                if len(fine) < len(going):
                    going, part = going[fine], part.take(fine)
                if not len(going):
                    break
            now.put(rows[going], part)
            left = np.flatnonzero(status != Status.CONVERGED)
            if not len(left):
                break
        return status, iterations

    def element_stretch(self, shapes: Shapes) -> Array:
        """(P, K, E): largest principal stretch in each element, of its Gauss points."""
        p, k = shapes.status.shape
        flat = self._stretch(shapes.displacement.reshape(p * k, -1, 2))
        return flat.max(axis=2).T.reshape(p, k, -1)

    def _stretch(self, displacement: Array) -> Array:
        """(E, B, q): largest principal stretch at every Gauss point of displacements (B, N, 2)."""
        (h11, h12), (h21, h22) = element.gradients(self.solid.ops, self.solid.by_element(displacement))
        a = (1 + h11) ** 2 + h12**2 + h21**2 + (1 + h22) ** 2
        J = (1 + h11) * (1 + h22) - h12 * h21
        return np.asarray(np.sqrt(0.5 * (a + np.sqrt(np.maximum(a * a - 4 * J * J, 0.0)))))


def _extrapolate(path: list[tuple[Array, Configuration]], load: Array) -> Configuration | None:
    """Lagrange extrapolation along a straight path in load space; None where there is nothing to go by."""
    if len(path) < 2:
        return None
    direction = load - path[-1][0]
    length2 = float(direction @ direction)
    if length2 == 0.0:
        return None
    places: list[float] = []
    used: list[Configuration] = []
    for earlier, configuration in path[:-6:-1]:
        offset = earlier - path[-1][0]
        t = float(offset @ direction) / length2
        # Off the line, ahead, or so close to another point that the polynomial would swing: go no further back.
        if np.linalg.norm(offset - t * direction) > 1e-9 * np.sqrt(length2) or (places and t > places[-1] - 0.2):
            break
        places.append(t)
        used.append(configuration)
    if len(places) < 2:
        return None
    weights = [prod((1.0 - s) / (t - s) for s in places if s != t) for t in places]
    return combine(weights, used)
