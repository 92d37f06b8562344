"""Compute the equilibria under a sequence of loads, one after another or all at once.

If they are solved one after another, Newton's method begins at an extrapolation of the solved states. If a step fails,
or may end on another equilibrium path, it is repeated in 4, 16 and 64 smaller steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import prod
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.actuation import LoadedMesh
from eimi_fitting.beam.element import Batch
from eimi_fitting.beam.equilibrium import Configuration, Solid, SolidLoads, Status, combine, joined, loads_joined
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.mesh import Indices
from eimi_fitting.laws.law import Law, Section
from eimi_fitting.laws.stability import stable_stretch
from eimi_fitting.units import MPA_PER_PA, moduli_in_MPa

Array = NDArray[np.float64]

BULK_RATIO = 1e4  # bulk over shear modulus of an incompressible material: changes the tip by less than 1e-4
# Largest ratio that is computed: a stiffer material bends the same to eight digits, but far above this ratio rounding
# errors keep Newton's method from converging.
_MOST_BULK_RATIO = 1e8
_CUTS = (1, 4, 16, 64)
# Largest number of iterations of a step that stays on its equilibrium path. It is 5 if the tolerance exceeds _LOOSE_MM.
_FEW = 6
_LOOSE_MM = 1e-3
_FAILED = (Status.DIVERGED, Status.OUT_OF_ITERATIONS)
_OF_STRAIN, _SMALL_STRAIN = 1.5, 0.02  # a strain is as predicted if it is below 1.5 times the predicted one plus 0.02
_MOST_POINTS = 5  # points of the path that an extrapolation uses
_AT_ONCE = 1400  # elements of all candidates and states together: more need more memory and save no time

Path = list[tuple[Array, Configuration]]
"""Solved states: for each state the m numbers that describe its loads (`Loads.state`), and its configuration."""
LoadsAt = Callable[[Array, Array], SolidLoads]
"""A function that computes the loads on the mesh, see `Loads.on`."""


@dataclass(frozen=True)
class Shapes:
    """The deformed shapes of the beam for all candidate laws and load states."""

    # P candidate laws, K load states, and N nodes in d dimensions. A state that could not be solved has the last shape
    # that was reached.

    # (P, K, N, d): displacements of the nodes in mm.
    displacement: Array
    # (P, K, 3): translation (x, y) of the magnet in mm, and its rotation in rad.
    rigid: Array
    # (P, K): `Status` of each state.
    status: NDArray[np.int8]
    # (P, K): number of tangent stiffnesses that were factorised.
    iterations: NDArray[np.intp]
    # (P, K): largest principal stretch in the silicone; 1 without a solution.
    max_stretch: Array
    # The configurations of all candidates in the last state.
    last: Configuration
    # The configurations of the first candidate in all states, if requested.
    every: Configuration | None = None

    @property
    def converged(self) -> NDArray[np.bool_]:
        """Whether each candidate law has the status CONVERGED in all load states."""
        return np.asarray((self.status == Status.CONVERGED).all(axis=1))

    def take(self, rows: NDArray[np.intp]) -> Shapes:
        """Return the shapes of some of the candidate laws only."""
        return Shapes(
            displacement=self.displacement[rows],
            rigid=self.rigid[rows],
            status=self.status[rows],
            iterations=self.iterations[rows],
            max_stretch=self.max_stretch[rows],
            last=self.last.take(rows),
            every=self.every if rows[0] == 0 else None,
        )


@dataclass(frozen=True)
class Candidates:
    """Candidates (sets of parameters of a hyperelastic law) that are solved together."""

    # P candidates.

    # The candidates with their parameters in MPa.
    batch: Batch
    # (P,): factor on the magnetic loads; None: 1.
    field_factor: Array | None
    # (P,): whether all numbers are finite and the moduli positive.
    sound: NDArray[np.bool_]

    def take(self, rows: Indices) -> tuple[Batch, Array]:
        """Return some of the candidate laws, and the factors by which their magnetic loads are multiplied."""
        batch = self.batch
        part = Batch(batch.law, batch.parameters[rows], batch.section, batch.bulk[rows])
        return part, np.ones(1) if self.field_factor is None else self.field_factor[rows]


def candidates(
    law: Law,
    parameters: Array,
    section: Section | Literal["solid"],
    bulk_modulus_Pa: Array | None,
    field_factor: Array | None,
) -> Candidates:
    """Convert sets of parameters of a law to candidates that are solved together.

    Raises
    ------
    ValueError
        A bulk modulus is given in plane stress.
    """
    # ``law``: the hyperelastic law.
    # ``parameters`` (P, n): the n parameters of each of P candidates; moduli in Pa.
    # ``section``: how the depth is modelled.
    # ``bulk_modulus_Pa`` (P,): bulk modulus in Pa; None for an incompressible material.
    # ``field_factor`` (P,): factor on the magnetic loads; None: 1.
    parameters = np.atleast_2d(np.asarray(parameters, float))
    sound = np.asarray(np.isfinite(parameters).all(axis=1))
    scaled = moduli_in_MPa(np.where(sound[:, None], parameters, 1.0), law.units)
    with np.errstate(all="ignore"):
        mu = law.initial_shear_modulus(scaled)
    sound = sound & np.isfinite(mu) & (mu > 0)
    bulk = BULK_RATIO * np.where(sound, mu, 1.0)
    if bulk_modulus_Pa is not None:
        if section == "plane-stress":
            raise ValueError(
                "a bulk modulus is given, but plane stress is computed for incompressible materials only: leave the "
                "bulk modulus out, or choose another section"
            )
        bulk_MPa = np.broadcast_to(np.asarray(bulk_modulus_Pa, float) * MPA_PER_PA, bulk.shape)
        sound = sound & np.isfinite(bulk_MPa) & (bulk_MPa > 0)
        bulk = np.where(sound, np.minimum(bulk_MPa, _MOST_BULK_RATIO * mu), bulk)
    factor = None
    if field_factor is not None:
        factor = np.broadcast_to(np.asarray(field_factor, float), sound.shape)
        sound = sound & np.isfinite(factor)
    return Candidates(Batch(law, scaled, section, bulk), factor, sound)


def follow(
    solid: Solid,
    mesh: LoadedMesh,
    chosen: Candidates,
    loads: Loads,
    tolerance_mm: float,
    start: Configuration | None,
    keep: bool = False,
    beside: Configuration | None = None,
) -> Shapes:
    """Solve one load state after another, for all candidate laws together."""
    # ``keep``: whether to store the configurations of the first candidate (``Shapes.every``). ``beside``: for one
    # candidate, configurations of a similar beam model, one row for each state, near which Newton's method begins.
    p, k_states = len(chosen.sound), len(loads)
    loads_at = loads.on(mesh)
    now = solid.rest(p) if start is None else start.copy()
    shapes = Shapes(
        np.zeros((p, k_states, *solid.mesh.nodes.shape)),
        np.zeros((p, k_states, 3)),
        np.full((p, k_states), Status.DIVERGED, np.int8),
        np.zeros((p, k_states), np.intp),
        np.ones((p, k_states)),
        now,
    )
    rows = np.flatnonzero(chosen.sound)
    path: Path = [(loads.at_rest(), solid.rest(p))]
    apart: Path = []  # differences between this model and the one beside it
    first: list[Configuration] = []
    for k in range(k_states):
        load = loads.state(k)
        near = start if k == 0 else None
        there = None if beside is None else beside.take(np.array([k]))
        if there is not None and len(rows):
            near = combine([1.0, 1.0], [there, _extrapolate(apart, load) or apart[-1][1]]) if apart else there
        with np.errstate(all="ignore"):
            status, iterations = _advance(solid, loads_at, chosen, rows, path, load, now, tolerance_mm, near)
        shapes.displacement[:, k] = now.displacement
        shapes.rigid[:, k] = now.rigid
        shapes.status[rows, k] = status
        shapes.iterations[rows, k] = iterations
        rows = rows[status == Status.CONVERGED]
        shapes.max_stretch[rows, k] = solid.stretch(now.displacement[rows]).max(axis=(0, 2))
        path = [*path[1 - _MOST_POINTS :], (load, now.copy())]
        if there is not None:
            apart = [*apart[1 - _MOST_POINTS :], (load, combine([1.0, -1.0], [now, there]))]
        if keep:
            first.append(now.take(np.arange(1)))
    mark_unstable(chosen, shapes)
    return replace(shapes, every=joined(first)) if keep else shapes


def at_once(
    solid: Solid,
    mesh: LoadedMesh,
    chosen: Candidates,
    loads: Loads,
    tolerance_mm: float,
    near: Configuration,
    keep: bool = False,
) -> Shapes | None:
    """Solve all load states of all candidate laws at once; return None if this fails."""
    # ``near``: configurations of a similar beam, one row for each state, with which Newton's method begins. ``keep``:
    # whether to store the configurations of the first candidate.
    p, k_states = len(chosen.sound), len(loads)
    loads_at = loads.on(mesh)
    if not chosen.sound.all():
        return None
    displacement, rigid = np.empty((p, k_states, *solid.mesh.nodes.shape)), np.empty((p, k_states, 3))
    status, iterations = np.empty((p, k_states), np.int8), np.empty((p, k_states), np.intp)
    stretch = np.empty((p, k_states))
    first: list[Configuration] = []
    parts = -(-k_states * p * len(solid.mesh.elements) // _AT_ONCE)
    for states in np.array_split(np.arange(k_states), min(parts, k_states)):
        batch, factor = chosen.take(np.tile(np.arange(p), len(states)))
        starts = near.take(np.repeat(states, p))
        factor = np.broadcast_to(factor, len(starts.rigid))[:p]
        loads_of_part = loads_joined([loads_at(loads.state(k), factor) for k in states])
        with np.errstate(all="ignore"):
            there, outcome, spent = solid.equilibrium(batch, loads_of_part, starts, tolerance_mm, _FEW, only_try=True)
            if not ((outcome == Status.CONVERGED).all() and _as_predicted(solid, starts, there).all()):
                return None
        shape = (len(states), p)
        displacement[:, states] = there.displacement.reshape(*shape, *displacement.shape[2:]).swapaxes(0, 1)
        rigid[:, states] = there.rigid.reshape(*shape, 3).swapaxes(0, 1)
        status[:, states], iterations[:, states] = outcome.reshape(shape).T, spent.reshape(shape).T
        stretch[:, states] = solid.stretch(there.displacement).max(axis=(0, 2)).reshape(shape).T
        if keep:
            first.append(there.take(p * np.arange(len(states))))
    last = there.take(np.arange(len(outcome) - p, len(outcome)))
    shapes = Shapes(displacement, rigid, status, iterations, stretch, last, joined(first) if keep else None)
    mark_unstable(chosen, shapes)
    return shapes


def mark_unstable(chosen: Candidates, shapes: Shapes) -> None:
    """Set the status UNSTABLE in each converged state beyond the stable range of the law."""
    batch = chosen.batch
    limit = stable_stretch(batch.law, batch.parameters, shapes.max_stretch.max(axis=1))
    beyond = shapes.max_stretch > limit[:, None] * (1 + 1e-9)
    shapes.status[(shapes.status == Status.CONVERGED) & beyond] = Status.UNSTABLE


def _advance(
    solid: Solid,
    loads_at: LoadsAt,
    chosen: Candidates,
    rows: Indices,
    path: Path,
    load: Array,
    now: Configuration,
    tolerance_mm: float,
    near: Configuration | None,
) -> tuple[NDArray[np.int8], NDArray[np.intp]]:
    """Find the equilibria of candidate laws under the next load; return status and number of iterations."""
    # ``rows``: the candidates. ``path``: the equilibria under earlier loads. ``now``: the configurations, which are
    # overwritten.
    status = np.full(len(rows), Status.DIVERGED, np.int8)
    # Whether a candidate buckled in the last attempt, with a solution that is certainly on its equilibrium path.
    lost = np.zeros(len(rows), bool)
    iterations = np.zeros(len(rows), np.intp)
    unfinished = np.arange(len(rows))  # places in ``rows`` that have not arrived
    for cuts in _CUTS if near is None else (0, *_CUTS):
        way = [(load, near)] if near is not None and cuts == 0 else path
        part, outcome, spent, sure = _divided(
            solid, loads_at, chosen, rows[unfinished], way, load, max(cuts, 1), tolerance_mm, cuts == 0
        )
        arrived = np.flatnonzero(outcome == Status.CONVERGED)
        now.put(rows[unfinished[arrived]], part.take(arrived))
        iterations[unfinished] += spent
        status[unfinished] = np.where(sure | (outcome != Status.CONVERGED), outcome, Status.ASTRAY)
        failed = status[unfinished] != Status.CONVERGED
        if not failed.any():
            break
        lost_now = sure & (outcome == Status.BUCKLED) & (cuts > 0)
        ended = lost_now & lost[unfinished]
        lost[unfinished] = lost_now
        unfinished = unfinished[failed & ~ended]
        if not len(unfinished):
            break
    return status, iterations


def _divided(
    solid: Solid,
    loads_at: LoadsAt,
    chosen: Candidates,
    rows: Indices,
    path: Path,
    load: Array,
    cuts: int,
    tolerance_mm: float,
    only_try: bool = False,
) -> tuple[Configuration, NDArray[np.int8], NDArray[np.intp], NDArray[np.bool_]]:
    """Find the equilibria of candidate laws under the next load, which is reached in several equal steps."""
    # The results: configuration, status, number of iterations, and whether the solution is certainly on the equilibrium
    # path. ``rows``: the candidates. ``cuts``: number of steps.
    few = _FEW - (tolerance_mm > _LOOSE_MM)
    most = few if cuts < _CUTS[-1] else None  # a candidate that needs more is repeated in smaller steps
    everyone = len(rows) == len(path[-1][1].rigid)
    recent = path[-_MOST_POINTS:] if everyone else _taken(path, rows)
    previous = path[-1][0]
    reached = recent[-1][1].copy()
    status = np.full(len(rows), Status.DIVERGED, np.int8)
    iterations = np.zeros(len(rows), np.intp)
    sure = np.ones(len(rows), bool)
    going = np.arange(len(rows))
    for c in range(1, cuts + 1):
        target = previous + (load - previous) * c / cuts
        # The first of several small steps starts at the last state, because the extrapolation has failed before.
        predicted = _extrapolate(recent, target) if cuts == 1 or c > 1 else None
        guess = predicted or recent[-1][1]
        batch, factor = chosen.take(rows[going])
        part, outcome, spent = solid.equilibrium(batch, loads_at(target, factor), guess, tolerance_mm, most, only_try)
        # If Newton's method needs many iterations, it may end at an equilibrium of another path (Deuflhard 2011, Newton
        # Methods for Nonlinear Problems, section 5.1).
        contracts = spent <= few
        if predicted is not None:
            contracts &= _as_predicted(solid, predicted, part)
        again = np.flatnonzero(~contracts | np.isin(outcome, _FAILED))
        if predicted is not None and cuts == _CUTS[-1] and len(again):
            # An extrapolated rotation lengthens the beam: the nodes move along straight lines and not along arcs. The
            # last attempt therefore starts at the last state of the path.
            batch, factor = chosen.take(rows[going[again]])
            other, ended, more = solid.equilibrium(
                batch, loads_at(target, factor), recent[-1][1].take(again), tolerance_mm
            )
            better = np.flatnonzero((ended == Status.CONVERGED) & (more <= few))
            part.put(again[better], other.take(better))
            outcome[again[better]], contracts[again[better]] = Status.CONVERGED, True
            spent[again] += more
        reached.put(going, part)
        iterations[going] += spent
        status[going] = outcome
        sure[going] &= contracts
        recent = [*recent, (target, part)]
        keep = np.flatnonzero((outcome == Status.CONVERGED) & (sure[going] | (cuts == _CUTS[-1])))
        if len(keep) < len(going):
            going, recent = going[keep], _taken(recent, keep)
        if not len(going):
            break
    return reached, status, iterations, sure


def _as_predicted(solid: Solid, predicted: Configuration, solved: Configuration) -> NDArray[np.bool_]:
    """Return whether the largest strain of each solution is not much larger than predicted."""
    before, after = (solid.stretch(c.displacement).max(axis=(0, 2)) - 1 for c in (predicted, solved))
    return np.asarray(after < _OF_STRAIN * before + _SMALL_STRAIN)


def _taken(path: Path, rows: Indices) -> Path:
    return [(load, configuration.take(rows)) for load, configuration in path[-_MOST_POINTS:]]


def _extrapolate(path: Path, load: Array) -> Configuration | None:
    """Extrapolate the configuration under a load from the equilibria under earlier loads."""
    # None if there are too few of them.
    if len(path) < 2:
        return None
    direction = load - path[-1][0]
    length2 = float(direction @ direction)
    if length2 == 0.0:
        return None
    places: list[float] = []
    used: list[Configuration] = []
    for earlier, configuration in path[: -_MOST_POINTS - 1 : -1]:
        offset = earlier - path[-1][0]
        t = float(offset @ direction) / length2
        # The points are used up to the first one that does not lie on the line of the loads, or that is not at least
        # 0.2 steps before the point that was used last. With closer points, the polynomial would oscillate.
        if np.linalg.norm(offset - t * direction) > 1e-9 * np.sqrt(length2) or (places and t > places[-1] - 0.2):
            break
        places.append(t)
        used.append(configuration)
    if len(places) < 2:
        return None
    weights = [prod((1.0 - s) / (t - s) for s in places if s != t) for t in places]
    return combine(weights, used)
