"""The states one after another: load steps, extrapolated starts, smaller steps where one fails."""

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
# Of any material: a stiffer one bends the same to eight digits, but far above it rounding leaves Newton no equilibrium.
_MOST_BULK_RATIO = 1e8
_CUTS = (1, 4, 16, 64)
_FEW = 6  # iterations of a step that stays on its path, to a tolerance of micrometres; one less to a loose one
_LOOSE_MM = 1e-3
_FAILED = (Status.DIVERGED, Status.OUT_OF_ITERATIONS)
_OF_STRAIN, _SMALL_STRAIN = 1.5, 0.02
_MOST_POINTS = 6  # of the path, that an extrapolation looks at
_AT_ONCE = 1400  # elements, of all candidates and states: more of them need more memory, and no less time

Path = list[tuple[Array, Configuration]]
"""Numbers of a state's loads (m,), see `Loads.state`, and where the candidates stood under them."""
LoadsAt = Callable[[Array, Array], SolidLoads]
"""The loads on the mesh, from a state's numbers and the candidates' field factors; see `Loads.on`."""


@dataclass(frozen=True)
class Shapes:
    """P candidates in K states.

    displacement: (P, K, N, d) mm; rigid: (P, K, 3) mm, mm, rad (rotation of the magnet, zero without one);
    status: (P, K) Status; iterations: (P, K) tangents factorised; max_stretch: (P, K) largest principal stretch.
    Rows that are not converged hold the last place reached: look at the status. last: where the candidates stand in the
    last state; every: where the first one stands in each state, a row a state, if that was asked for.
    """

    displacement: Array
    rigid: Array
    status: NDArray[np.int8]
    iterations: NDArray[np.intp]
    max_stretch: Array
    last: Configuration
    every: Configuration | None = None

    @property
    def converged(self) -> NDArray[np.bool_]:
        """(P,) every state converged."""
        return np.asarray((self.status == Status.CONVERGED).all(axis=1))

    def take(self, rows: NDArray[np.intp]) -> Shapes:
        """Some of the candidates, or some of them more than once."""
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
    """P candidates, scaled to MPa, and what each makes of the magnetic loads.

    field_factor: (P,), None for all as they are; sound: (P,) which of them make sense at all.
    """

    batch: Batch
    field_factor: Array | None
    sound: NDArray[np.bool_]

    def take(self, rows: Indices) -> tuple[Batch, Array]:
        """Some of them, and their factors, or one for all."""
        batch = self.batch
        own = Batch(batch.law, batch.parameters[rows], batch.section, batch.bulk[rows])
        return own, np.ones(1) if self.field_factor is None else self.field_factor[rows]


def candidates(
    law: Law,
    parameters: Array,
    section: Section | Literal["solid"],
    bulk_modulus_Pa: Array | None,
    field_factor: Array | None,
) -> Candidates:
    """Parameters (P, n) in the law's units (Pa), bulk moduli (P,) and factors (P,) as `BeamModel.solve` takes them."""
    parameters = np.atleast_2d(np.asarray(parameters, float))
    sound = np.asarray(np.isfinite(parameters).all(axis=1))
    scaled = moduli_in_MPa(np.where(sound[:, None], parameters, 1.0), law.units)
    with np.errstate(all="ignore"):
        mu = law.initial_shear_modulus(scaled)
    sound = sound & np.isfinite(mu) & (mu > 0)
    bulk = BULK_RATIO * np.where(sound, mu, 1.0)
    if bulk_modulus_Pa is not None:
        if section == "plane-stress":
            raise ValueError("plane stress is incompressible here: it takes no bulk modulus")
        given = np.broadcast_to(np.asarray(bulk_modulus_Pa, float) * MPA_PER_PA, bulk.shape)
        sound = sound & np.isfinite(given) & (given > 0)
        bulk = np.where(sound, np.minimum(given, _MOST_BULK_RATIO * mu), bulk)
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
    """Take the candidates through the K states in order; see `BeamModel.solve`; keep: `Shapes.every`.

    beside: of one candidate, where a model that moves much as this one does stands, a row a state: what is between the
    two is extrapolated, and tried first.
    """
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
    apart: Path = []  # what is between this model and the one beside it
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
    """Candidates in many states together, each from where a beam near it stands: a row of ``near`` a state.

    None where Newton's method does not contract at once from there, for one of them.
    """
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
        own = near.take(np.repeat(states, p))
        factor = np.broadcast_to(factor, len(own.rigid))[:p]
        every = loads_joined([loads_at(loads.state(k), factor) for k in states])
        with np.errstate(all="ignore"):
            there, told, spent = solid.equilibrium(batch, every, own, tolerance_mm, _FEW, only_try=True)
            if not ((told == Status.CONVERGED).all() and _as_foretold(solid, own, there).all()):
                return None
        shape = (len(states), p)
        displacement[:, states] = there.displacement.reshape(*shape, *displacement.shape[2:]).swapaxes(0, 1)
        rigid[:, states] = there.rigid.reshape(*shape, 3).swapaxes(0, 1)
        status[:, states], iterations[:, states] = told.reshape(shape).T, spent.reshape(shape).T
        stretch[:, states] = solid.stretch(there.displacement).max(axis=(0, 2)).reshape(shape).T
        if keep:
            first.append(there.take(p * np.arange(len(states))))
    last = there.take(np.arange(len(told) - p, len(told)))
    shapes = Shapes(displacement, rigid, status, iterations, stretch, last, joined(first) if keep else None)
    mark_unstable(chosen, shapes)
    return shapes


def mark_unstable(chosen: Candidates, shapes: Shapes) -> None:
    """Mark states in equilibrium whose candidate's law is not Drucker-stable over the stretches reached."""
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
    """Bring ``rows`` of ``now`` to the new load: in one step or, where that fails or may stray, in 4, in 16, in 64.

    A path that loses its stability before the load does so in steps of any size: who is sure of it in two sizes, one
    after the other, is not taken through smaller ones. near: where a load close to this one has led; tried first.
    """
    status = np.full(len(rows), Status.DIVERGED, np.int8)
    lost = np.zeros(len(rows), bool)  # their stability, in steps of the last size
    iterations = np.zeros(len(rows), np.intp)
    left = np.arange(len(rows))  # places in ``rows`` that have not arrived
    for cuts in _CUTS if near is None else (0, *_CUTS):
        way = [(load, near)] if near is not None and cuts == 0 else path
        part, outcome, spent, sure = _divided(
            solid, loads_at, chosen, rows[left], way, load, max(cuts, 1), tolerance_mm, cuts == 0
        )
        arrived = np.flatnonzero(outcome == Status.CONVERGED)
        now.put(rows[left[arrived]], part.take(arrived))
        iterations[left] += spent
        status[left] = np.where(sure | (outcome != Status.CONVERGED), outcome, Status.ASTRAY)
        failed = status[left] != Status.CONVERGED
        if not failed.any():
            break
        lost_now = sure & (outcome == Status.BUCKLED) & (cuts > 0)
        ended = lost_now & lost[left]
        lost[left] = lost_now
        left = left[failed & ~ended]
        if not len(left):
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
    """Take ``rows`` from the path's end to the load in equal steps: places, Status, iterations, and who is sure.

    Newton's method that does not contract at once may end at another equilibrium than the one that the loads lead to
    (Deuflhard 2011, Newton Methods for Nonlinear Problems, section 5.1). Sure is who took few iterations in each step.
    only_try: see `Solid.equilibrium`.
    """
    few = _FEW - (tolerance_mm > _LOOSE_MM)
    most = few if cuts < _CUTS[-1] else None  # who takes more is not sure, and has smaller steps to come
    everyone = len(rows) == len(path[-1][1].rigid)
    own = path[-_MOST_POINTS:] if everyone else _taken(path, rows)
    previous = path[-1][0]
    reached = own[-1][1].copy()
    status = np.full(len(rows), Status.DIVERGED, np.int8)
    iterations = np.zeros(len(rows), np.intp)
    sure = np.ones(len(rows), bool)
    going = np.arange(len(rows))
    for c in range(1, cuts + 1):
        target = previous + (load - previous) * c / cuts
        # Where whole steps have failed the path through them is no guide to small ones: the first begins where it is.
        foretold = _extrapolate(own, target) if cuts == 1 or c > 1 else None
        guess = foretold or own[-1][1]
        batch, factor = chosen.take(rows[going])
        part, outcome, spent = solid.equilibrium(batch, loads_at(target, factor), guess, tolerance_mm, most, only_try)
        contracts = spent <= few
        if foretold is not None:
            contracts &= _as_foretold(solid, foretold, part)
        again = np.flatnonzero(~contracts | np.isin(outcome, _FAILED))
        if foretold is not None and cuts == _CUTS[-1] and len(again):
            # A beam that has only begun to turn is foretold too long, by the turn's square: at last from where it is.
            batch, factor = chosen.take(rows[going[again]])
            other, ended, more = solid.equilibrium(
                batch, loads_at(target, factor), own[-1][1].take(again), tolerance_mm
            )
            better = np.flatnonzero((ended == Status.CONVERGED) & (more <= few))
            part.put(again[better], other.take(better))
            outcome[again[better]], contracts[again[better]] = Status.CONVERGED, True
            spent[again] += more
        reached.put(going, part)
        iterations[going] += spent
        status[going] = outcome
        sure[going] &= contracts
        own = [*own, (target, part)]
        keep = np.flatnonzero((outcome == Status.CONVERGED) & (sure[going] | (cuts == _CUTS[-1])))
        if len(keep) < len(going):
            going, own = going[keep], _taken(own, keep)
        if not len(going):
            break
    return reached, status, iterations, sure


def _as_foretold(solid: Solid, foretold: Configuration, found: Configuration) -> NDArray[np.bool_]:
    """(B,): whether the largest strain is of the size that the path foretold; a fold in a corner's is far larger."""
    before, after = (solid.stretch(c.displacement).max(axis=(0, 2)) - 1 for c in (foretold, found))
    return np.asarray(after < _OF_STRAIN * before + _SMALL_STRAIN)


def _taken(path: Path, rows: Indices) -> Path:
    return [(load, configuration.take(rows)) for load, configuration in path[-_MOST_POINTS:]]


def _extrapolate(path: Path, load: Array) -> Configuration | None:
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
