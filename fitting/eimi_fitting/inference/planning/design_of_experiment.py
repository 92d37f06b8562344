"""Which states to measure next, for an interval as narrow as can be or for two laws as far apart as can be.

Every state that could be measured is linearised about a law that is known already: how its edges move with the
unknowns (J), and with one standard uncertainty of each stated source (C). With w the inverse variance of as many points
as count as one, alike in all states, a choice of states has, by sums over them,

information       A = w sum J'J,  H = A + P with the inverse variances P of what was known before
sources' steps    S = inv(H) w sum J'C
variance          inv(H) (t^2 A + P) inv(H) + S S'

which is what `inference.interval.covariance` and `inference.interval.considered` make of the measurement when it is
there. Among the
candidates states are exchanged one at a time for the one that helps most, until none helps (Fedorov 1972, Theory of
Optimal Experiments, section 3.3; Atkinson and Donev 1992, Optimum Experimental Designs, section 15.4), from equally
spaced states and from those that help most one by one.

Two laws are told apart by what the rival leaves of the first one's edges, refitted, in units of the noise: the
noncentrality of T-optimality (Atkinson and Fedorov 1975, Biometrika 62:57). It is what AIC grows by.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special

from eimi_fitting.beam.equilibrium import Status
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.inference.evidence.corrections import FINER_MESH, MESH_ORDER, correction
from eimi_fitting.inference.evidence.experiment import Experiment, compare
from eimi_fitting.inference.evidence.measurements import EdgeObservation, edge_curves, points_on
from eimi_fitting.inference.evidence.objective import Problem
from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_fitting.inference.evidence.unknowns import Unknowns
from eimi_fitting.inference.interval.considered import considered
from eimi_fitting.inference.interval.identifiability import Identifiability
from eimi_fitting.inference.searching.polish import difference_batch
from eimi_fitting.laws.law import Law
from eimi_fitting.laws.search_space import search_space

Array = NDArray[np.float64]
Choice = NDArray[np.intp]

MODULUS = "initial shear modulus"
_NORMAL = float(special.ndtri(0.975))
_DECADES = 1.5  # either way of the modulus: what `inference.searching.modulus_range` searches
_SWEEPS = 20
_GAIN = 1e-6  # of the criterion: an exchange that gains less is none
_SLOPE_STEP = 1e-4
_FIT_ALONG = 26  # elements of `BeamModel.refined`, on which a fit ends


@dataclass(frozen=True)
class KnownLaw:
    """A law with the parameters (n,) that are known so far."""

    law: Law
    parameters: Array

    def unknowns(self) -> tuple[Unknowns, Array]:
        """The unknowns of a fit of it, and where in them the parameters are (n,)."""
        modulus = float(self.law.initial_shear_modulus(self.parameters))
        space = search_space(self.law)
        lower, upper = (modulus * 10.0**end for end in (-_DECADES, _DECADES))
        space = replace(space, lower=(lower, *space.lower[1:]), upper=(upper, *space.upper[1:]))
        scale = np.where(np.array(self.law.units) == "Pa", modulus, 1.0)
        found = optimize.least_squares(
            lambda unit: (space.parameters(unit[None])[0] - self.parameters) / scale,
            np.full(len(space.names), 0.5),
            bounds=(0.0, 1.0),
            xtol=1e-12,
            ftol=1e-12,
            gtol=1e-12,
        )
        return Unknowns(space), np.asarray(found.x)


@dataclass(frozen=True)
class EdgeNoise:
    """residual_mm: standard deviation of a point; points: of both edges of a state; alike: of which so many count as
    one; left_percent: half-width of what the solid section leaves in the modulus.
    """

    residual_mm: float
    points: int
    alike: float
    left_percent: float = 0.0

    @staticmethod
    def of(told: Identifiability, states: int, left_percent: float = 0.0) -> EdgeNoise:
        """That of an earlier fit to so many states; where it did not say, all its residuals are taken for noise."""
        independent = told.noise_points or told.independent_points
        return EdgeNoise(
            residual_mm=told.noise_mm or told.residual_mm,
            points=round(told.points / states),
            alike=told.points / independent,
            left_percent=left_percent,
        )


@dataclass(frozen=True)
class Candidates:
    """S states of one specimen that could be measured, linearised.

    loads: theirs; states: (S,) the index of each among the loads that were considered.
    normal: (S, n, n) sums of J'J over a state's points, over the variance of as many as count as one;
    moved: (S, n, C) sums of J'C; sources: names of the C; prior: (n, n); goal: (n,) the derivative of what is to be
    known, as a share of it; points: of a state that are independent; left: standard deviation, as a share, that no
    state lowers.
    """

    loads: Loads
    states: Choice
    normal: Array
    moved: Array
    sources: tuple[str, ...]
    prior: Array
    goal: Array
    points: float
    left: float

    def __len__(self) -> int:
        return len(self.normal)

    def variance(self, choices: Choice) -> Array:
        """(D,): of the goal, as a share squared, for D choices (D, K) of states."""
        information, moved = self.normal[choices].sum(axis=1), self.moved[choices].sum(axis=1)
        goal = np.tile(self.goal, (len(choices), 1))[..., None]
        direction = np.linalg.solve(information + self.prior, goal)[..., 0]
        noise = np.einsum("di,dij,dj->d", direction, information, direction)
        known = np.einsum("di,ij,dj->d", direction, self.prior, direction)
        sources = (np.einsum("di,dic->dc", direction, moved) ** 2).sum(axis=1)
        return np.asarray(self._widened(choices.shape[1]) ** 2 * noise + known + sources + self.left**2)

    def half_width_percent(self, choice: Choice) -> float:
        """Of the 95 % interval to expect, in per cent of the value."""
        return 100 * _NORMAL * float(np.sqrt(self.variance(choice[None])[0]))

    def effects_percent(self, choice: Choice) -> dict[str, float]:
        """Standard deviation in per cent that each source gives the goal, largest first."""
        information, moved = self.normal[choice].sum(axis=0), self.moved[choice].sum(axis=0)
        effect = 100 * np.abs(np.linalg.solve(information + self.prior, self.goal) @ moved)
        return {self.sources[i]: float(effect[i]) for i in np.argsort(-effect)}

    def _widened(self, states: int) -> float:
        """Student's t over the normal quantile, as `inference.interval.estimate` has it."""
        freedom = max(min(self.points * states - len(self.goal), 2 * states - 1), 1.0)
        return float(special.stdtrit(freedom, 0.975)) / _NORMAL

    def least_percent(self, states: int) -> float:
        """No choice of so many of these states gives a narrower half-width, where there is one unknown.

        Noise: no state tells more than the one that tells most. Sources: the estimate errs by an average of what each
        state alone would err by, with weights that sum to one; the least sum of squares over all such weights is a
        problem of non-negative least squares. Raises ValueError for more unknowns.
        """
        if len(self.goal) > 1:
            raise ValueError(f"the bound is that of one unknown, not of {len(self.goal)}")
        own, known = self.normal[:, 0, 0], float(self.prior[0, 0])
        most = states * float(own.max())
        noise = (self.goal[0] / (most + known)) ** 2 * (self._widened(states) ** 2 * most + known)
        seen = own > 1e-9 * own.max()
        alone = self.goal[0] * self.moved[seen, 0] / own[seen, None]  # (S', C)
        heavy = 1e3 * max(float(np.abs(alone).max(initial=0.0)), 1e-6)
        rows = np.vstack([alone.T, np.full((1, int(seen.sum())), heavy)])
        weights, _ = optimize.nnls(rows, np.append(np.zeros(alone.shape[1]), heavy))
        held = most / (most + known)  # what was known before holds an estimate back
        sources = (held * (weights / weights.sum()) @ alone) ** 2
        return 100 * _NORMAL * float(np.sqrt(noise + sources.sum() + self.left**2))


@dataclass(frozen=True)
class Rivals:
    """S states in which two laws could be told apart.

    loads: theirs; states: (S,) the index of each among the loads that were considered.
    square: (S,) of what the rival leaves of the first law's edges; score: (S, m) and normal: (S, m, m) of the rival's
    unknowns and of the stated sources, all over the variance of as many points as count as one; prior: (m, m).
    """

    loads: Loads
    states: Choice
    square: Array
    score: Array
    normal: Array
    prior: Array

    def __len__(self) -> int:
        return len(self.square)

    def variance(self, choices: Choice) -> Array:
        """(D,): the inverse of `apart`."""
        square, score = self.square[choices].sum(axis=1), self.score[choices].sum(axis=1)
        step = np.linalg.solve(self.normal[choices].sum(axis=1) + self.prior, score[..., None])[..., 0]
        return np.asarray(1 / np.maximum(square - np.einsum("di,di->d", score, step), 1e-12))

    def apart(self, choice: Choice) -> float:
        """By how much AIC is expected to speak for the first law, where it is the true one."""
        return 1 / float(self.variance(choice[None])[0])


class Criterion(Protocol):
    """What a choice of states is good for."""

    def __len__(self) -> int:
        """Number of candidates."""

    def variance(self, choices: Choice) -> Array:
        """(D,) to be made small, of choices (D, K)."""


def candidates(
    known: KnownLaw,
    specimen: Specimen,
    loads: Loads,
    stated: Sequence[StatedSource],
    noise: EdgeNoise,
    goal: str = MODULUS,
    along: int = _FIT_ALONG,
) -> Candidates:
    """The states of ``loads`` that the beam reaches, linearised; the goal is the modulus or a parameter of the law.

    The plane stands for the solid: what depth changes in the edges' derivatives is a few per cent of them. along:
    elements of the fit's mesh, whose error is one more source. Raises KeyError for a goal that the law does not have,
    ValueError where no state is reached.
    """
    model = _planar_model(specimen)
    states = _reached(known, model, loads)
    experiment = _experiment(known, model, loads.take(states), stated, noise)
    unknowns, unit = known.unknowns()
    problem = Problem(known.law, unknowns, (experiment,))
    slopes = _slopes(problem, unit)
    scale = _over_variance(noise, slopes.shape[-1])
    moved = {s.name: change for s in considered(problem, unit) if (change := s.changes[0]) is not None}
    if specimen.section != "solid":  # whose residuals are on its own mesh
        moved |= _mesh(problem, unit, along)
    moves = np.array(list(moved.values())).reshape(len(moved), *slopes.shape[1:])
    return Candidates(
        loads=experiment.loads,
        states=states,
        normal=scale * np.einsum("ikgn,jkgn->kij", slopes, slopes),
        moved=scale * np.einsum("ikgn,ckgn->kic", slopes, moves),
        sources=tuple(moved),
        prior=np.diag(unknowns.prior),
        goal=_goal(known, unknowns, unit, goal),
        points=noise.points / noise.alike,
        left=noise.left_percent / 100 / _NORMAL,
    )


def rivals(
    known: KnownLaw,
    rival: KnownLaw,
    specimen: Specimen,
    loads: Loads,
    stated: Sequence[StatedSource],
    noise: EdgeNoise,
) -> Rivals:
    """The states of ``loads`` that both laws reach, where the first is true. Raises ValueError where none is."""
    model = _planar_model(specimen)
    states = _reached(rival, model, loads)
    states = states[_reached(known, model, loads.take(states))]
    experiment = _experiment(known, model, loads.take(states), stated, noise)
    unknowns, unit = rival.unknowns()
    problem = Problem(rival.law, unknowns, (experiment,))
    slopes = _slopes(problem, unit)
    left = compare(rival.law, rival.parameters[None], [experiment]).misfits[0].residuals[0]
    moved = [change for source in considered(problem, unit) if (change := source.changes[0]) is not None]
    every = np.concatenate([slopes, np.array(moved).reshape(len(moved), *slopes.shape[1:])])
    scale = _over_variance(noise, slopes.shape[-1])
    return Rivals(
        loads=experiment.loads,
        states=states,
        square=scale * np.einsum("kgn,kgn->k", left, left),
        score=scale * np.einsum("ikgn,kgn->ki", every, left),
        normal=scale * np.einsum("ikgn,jkgn->kij", every, every),
        prior=np.diag(np.concatenate([unknowns.prior, np.ones(len(moved))])),
    )


def equally_spaced(states: int, count: int) -> Choice:
    """(count,): of so many candidates in order, those that lie evenly from the first to the last."""
    return np.unique(np.round(np.linspace(0, states - 1, count)).astype(int))


def exchange(criterion: Criterion, count: int) -> Choice:
    """(count,) candidates, each once, in order, that no exchange of one for another betters.

    Raises ValueError where there are fewer candidates than that.
    """
    if count > len(criterion):
        raise ValueError(f"{count} states of {len(criterion)} candidates")
    begun = [equally_spaced(len(criterion), count), _filled(criterion, count)]
    ends = [_exchanged(criterion, choice) for choice in begun]
    return np.sort(min(ends, key=lambda choice: float(criterion.variance(choice[None])[0])))


def _filled(criterion: Criterion, count: int) -> Choice:
    """So many candidates, each the one that helps most beside those before."""
    chosen: list[int] = []
    while len(chosen) < count:
        others = np.setdiff1d(np.arange(len(criterion)), chosen)
        tried = np.column_stack([np.tile(np.array(chosen, int), (len(others), 1)), others])
        chosen = [*chosen, int(others[np.argmin(criterion.variance(tried))])]
    return np.array(chosen)


def _exchanged(criterion: Criterion, choice: Choice) -> Choice:
    best = float(criterion.variance(choice[None])[0])
    for _ in range(_SWEEPS):
        before = best
        for place in range(len(choice)):
            others = np.setdiff1d(np.arange(len(criterion)), choice)
            if not len(others):
                return choice
            tried = np.tile(choice, (len(others), 1))
            tried[:, place] = others
            values = criterion.variance(tried)
            if values.min() < best * (1 - _GAIN):
                choice, best = tried[np.argmin(values)], float(values.min())
        if best >= before * (1 - _GAIN):
            break
    return choice


def _planar_model(specimen: Specimen) -> BeamModel:
    """Return the planar model that stands for the specimen, on the mesh that a search uses."""
    return BeamModel(replace(specimen, section=specimen.planar_section))


def _reached(known: KnownLaw, model: BeamModel, loads: Loads) -> Choice:
    """Return the indices of the states in which the beam has an equilibrium. Raises ValueError if there is none."""
    converged = model.solve(known.law, known.parameters[None], loads).status[0] == Status.CONVERGED
    if not converged.any():
        raise ValueError("the beam finds no equilibrium in any of the states")
    return np.flatnonzero(converged)


def _experiment(
    known: KnownLaw, model: BeamModel, loads: Loads, stated: Sequence[StatedSource], noise: EdgeNoise
) -> Experiment:
    """Return the experiment that would be made with the known law, without noise."""
    shapes = model.solve(known.law, known.parameters[None], loads)
    edges = points_on(edge_curves(model, shapes)[0], 4)[:, :, 4:-4]
    observed = EdgeObservation(edges, np.full(edges.shape[:3], noise.residual_mm))
    return Experiment(model, loads, observed, stated=tuple(stated))


def _slopes(problem: Problem, unit: Array) -> Array:
    """(n, K, 2, m) mm: of the residuals in the unknowns."""
    batch, distance = difference_batch(unit)
    residuals = problem.evaluate(batch, 1.0).comparison.misfits[0].residuals
    n = len(unit)
    return np.asarray((residuals[1 : n + 1] - residuals[n + 1 :]) / distance[:, None, None, None])


def _mesh(problem: Problem, unit: Array, along: int) -> dict[str, Array]:
    """What a fit's correction for the mesh leaves in the residuals, as one standard deviation, of `along` elements."""
    found = correction(
        FINER_MESH,
        problem.experiments,
        problem.evaluate(unit[None], 1.0).comparison,
        lambda experiments: problem.evaluate(unit[None], 1.0, experiments).comparison,
    )
    if found is None:
        return {}
    own = (problem.experiments[0].model.along / along) ** MESH_ORDER
    return {FINER_MESH.name: own * FINER_MESH.remaining_share / _NORMAL * found.changes[0]}


def _over_variance(noise: EdgeNoise, an_edge: int) -> float:
    """From sums of squares over simulated points, so many an edge, to those of measured ones in units of the noise."""
    return noise.points / (2 * an_edge) / (noise.alike * noise.residual_mm**2)


def _goal(known: KnownLaw, unknowns: Unknowns, unit: Array, goal: str) -> Array:
    """(n,): derivative of the goal, as a share of its value. Raises KeyError."""
    names = known.law.parameter_names
    if goal != MODULUS and goal not in names:
        raise KeyError(goal)

    def value(units: Array) -> Array:
        parameters = unknowns.parameters(units)
        if goal == MODULUS:
            return known.law.initial_shear_modulus(parameters)
        return np.asarray(parameters[:, names.index(goal)])

    step = _SLOPE_STEP * np.eye(len(unit))
    ahead, behind = np.minimum(unit + step, 1.0), np.maximum(unit - step, 0.0)
    slope = (value(ahead) - value(behind)) / np.diag(ahead - behind)
    return np.asarray(slope / abs(float(value(unit[None])[0])))
