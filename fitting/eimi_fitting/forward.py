"""The forward model: parameters in, the beam's shape in every state out, for a whole population at once."""

from __future__ import annotations

from dataclasses import dataclass
from math import prod

import numpy as np
from numpy.typing import NDArray

from eimi_fitting import element
from eimi_fitting.actuation import Actuation, Loads
from eimi_fitting.element import Batch
from eimi_fitting.grid import Grid
from eimi_fitting.materials import Law
from eimi_fitting.mesh import Indices
from eimi_fitting.solid import Configuration, Solid, Status, combine
from eimi_fitting.specimen import Specimen
from eimi_fitting.stability import stable_stretch

Array = NDArray[np.float64]

BULK_RATIO = 1e4  # bulk over shear modulus of an incompressible material: changes the tip by less than 1e-4
# Of any material: a stiffer one bends the same to eight digits, but far above it rounding leaves Newton no equilibrium.
_MOST_BULK_RATIO = 1e8
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

    along: elements of the flexible part; across: over the width, following from the proportions unless given; see
    `Grid`. The magnet is rigid; the model works per unit depth of the specimen, and silicone before and behind a
    shallower magnet is carried along. Raises ValueError when the magnet leaves no flexible part.
    """

    def __init__(self, specimen: Specimen, along: int = 13, across: int | None = None) -> None:
        self.specimen = specimen
        flexible, width = specimen.flexible_length_mm, specimen.width_mm
        if flexible <= 0:
            raise ValueError(
                f"a {specimen.length_mm - flexible:g} mm magnet leaves nothing of a beam of {specimen.length_mm:g} mm"
            )
        if across is None:
            across = max(1, round(0.5 * along * min(width / flexible, 1.0)))
        self.along, self.across = along, across
        self.grid = Grid(specimen, along, across)
        self.mesh = self.grid.mesh
        fixed = np.zeros((len(self.mesh.nodes), 2), bool)
        fixed[self.mesh.column(0)] = True
        self.solid = Solid(self.mesh, fixed, self.grid.magnet_nodes, (flexible, 0.0), self.grid.pressure_face())
        self._actuation = Actuation(self.grid, self.solid)

    def refined(self) -> BeamModel:
        """The same specimen on a mesh twice as fine along and three times across."""
        return BeamModel(self.specimen, 2 * self.along, 3 * self.across)

    def halved(self) -> BeamModel:
        """The same specimen on elements of half the size."""
        return BeamModel(self.specimen, 2 * self.along, 2 * self.across)

    def place(self, points_mm: Array) -> tuple[Indices, Array]:
        """`Grid.place`: nodes and weights that give the displacement of material points. Raises ValueError."""
        return self.grid.place(points_mm)

    def positions(self, shapes: Shapes, points_mm: Array) -> Array:
        """(P, K, n, 2): where the material points (n, 2), given at rest, are in each state. Raises ValueError."""
        points = np.atleast_2d(np.asarray(points_mm, float))
        p, k = shapes.status.shape
        moved = np.empty((p, k, len(points), 2))
        on_magnet = self.grid.on_magnet(points)
        nodes, weights = self.place(points[~on_magnet])
        moved[:, :, ~on_magnet] = points[~on_magnet] + np.einsum(
            "pknai,na->pkni", shapes.displacement[:, :, nodes], weights
        )
        moved[:, :, on_magnet] = self.carried(shapes, points[on_magnet])
        return moved

    def carried(self, shapes: Shapes, points_mm: Array) -> Array:
        """(P, K, n, 2): where points (n, 2) of the magnet are in each state."""
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

    def solve(
        self,
        law: Law,
        parameters: Array,
        loads: Loads,
        *,
        tolerance_mm: float = 1e-6,
        start: Configuration | None = None,
        bulk_modulus_Pa: Array | None = None,
        field_factor: Array | None = None,
    ) -> Shapes:
        """Take P candidates, parameters (P, n) in the law's units (Pa), through the K states in order.

        The first state is reached from rest (or from ``start``, the ``last`` of an earlier result), each further one
        by extrapolation from those before. A step that fails is cut into smaller ones; a candidate that fails for
        good is marked in this and in all later states, and no longer computed. The material is incompressible unless
        bulk moduli (P,) are given, which plane stress does not know: ValueError. field_factor (P,) multiplies each
        candidate's magnetic loads: an uncertain magnetic moment or coil constant. Raises ValueError for a pressure on a
        specimen that has no pressure face.
        """
        if np.any(loads.pressure_Pa) and self.solid.face is None:
            raise ValueError("a pressure is given, but the specimen names no face for it")
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
            bulk = np.where(sound, np.minimum(given, _MOST_BULK_RATIO * mu), bulk)
        factor = None
        if field_factor is not None:
            factor = np.broadcast_to(np.asarray(field_factor, float), sound.shape)
            sound = sound & np.isfinite(factor)
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
        previous = np.zeros(7)
        for k in range(k_states):
            load = loads.state(k)
            with np.errstate(all="ignore"):
                guess = _extrapolate(path, load) or now.copy()
                status, iterations = self._advance(batch, factor, rows, previous, load, guess, now, tolerance_mm)
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
        factor: Array | None,
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
                own_factor = np.ones(1) if factor is None else factor[rows[going]]
                dead = self._actuation.at(previous + (load - previous) * c / cuts, own_factor)
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
