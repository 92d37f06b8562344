"""Noise told from stated sources: the evidence where unknowns and sources together explain it best.

What a wrong width leaves along both edges is no noise: it is in the intervals as what it does to the estimate, and
would else be there twice. How much of each source the residuals show is found together with the unknowns by least
squares, with its stated uncertainty as what was known before; level and correlation of the noise are those of the
rest, and laws are compared by it. Residuals and slopes are evaluated anew where they lead, by Gauss-Newton: a source
acts in proportion to some per cent only, and noise may be less than that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.evidence._quadratic import step_to_minimum
from eimi_fitting.inference.evidence.measurements import Misfit
from eimi_fitting.inference.evidence.objective import Evaluation, Problem
from eimi_fitting.inference.evidence.unknowns import RANGE, Unknowns
from eimi_fitting.inference.interval.considered import ConsideredSources, changes_of
from eimi_fitting.inference.interval.covariance import Linearisation, LinearStates, linearise, point_correlation
from eimi_fitting.inference.searching.polish import Optimum, difference_batch

Array = NDArray[np.float64]

_ROUNDS = 12  # at most, in which noise and sources share the residuals
_SAME = 0.01  # of the noise from round to round
_PASSES = 3  # at most, from where the last one led


@dataclass(frozen=True)
class Explained:
    """What the evidence says where unknowns and sources explain it best.

    states: one an experiment, with slopes (n + S, K, G, m) in the unknowns and in the sources as if these were freed,
    and the weights that the noise gives them; hessian: (n + S, n + S); squares: sum of squares of what priors and
    sources are off by, in standard uncertainties.
    """

    states: tuple[LinearStates, ...]
    hessian: Array
    squares: float


@dataclass(frozen=True)
class Noise:
    """`linearise`, with the noise told from the sources, and how they explain the residuals."""

    about: Linearisation
    explained: Explained


def linearise_noise(
    problem: Problem,
    optimum: Optimum[Evaluation],
    sources: Sequence[ConsideredSources],
    model_mm: Sequence[Array] | None = None,
) -> Noise:
    """`linearise`, with the noise's level and correlation from what the sources do not explain of the residuals.

    The likelihood takes as many points as make the same noise of what is left: N of the rest, times the square of all
    residuals over those. model_mm: (K,) of each experiment, by how much the model itself may be wrong: sources are not
    asked to explain less than that.
    """
    about = linearise(problem, optimum)
    if not sources:
        return Noise(about, Explained(about.states, about.hessian, float((about.priors**2).sum())))
    explained = _explained(problem, about, sources, model_mm or [np.zeros(1)] * len(about.states))
    points = _independent(problem, explained.states)
    noise_mm = _mean_mm(explained.states)
    about = linearise(problem, optimum, points * (_mean_mm(about.states) / noise_mm) ** 2)
    variance = about.score_variance
    for own, clean, experiment in zip(about.states, explained.states, problem.experiments, strict=True):
        noise = replace(own, residuals=clean.residuals, error_mm=clean.error_mm)
        variance = variance - own.score_variance(experiment.observed) + noise.score_variance(experiment.observed)
    return Noise(replace(about, score_variance=variance, noise_points=points, noise_mm=noise_mm), explained)


def _mean_mm(states: Sequence[LinearStates]) -> float:
    return float(np.mean(np.concatenate([own.error_mm for own in states])))


def _independent(problem: Problem, states: Sequence[LinearStates]) -> float:
    return sum(
        float(own.used.sum()) / point_correlation(own.residuals, own.used, experiment.observed)
        for own, experiment in zip(states, problem.experiments, strict=True)
    )


def _explained(
    problem: Problem, about: Linearisation, sources: Sequence[ConsideredSources], model_mm: Sequence[Array]
) -> Explained:
    unknowns = Unknowns(problem.unknowns.space, (*problem.unknowns.freed, *(source.freed for source in sources)))
    freed = replace(problem, unknowns=unknowns)
    unit, n = np.concatenate([about.unit, np.full(len(sources), 0.5)]), len(about.unit)
    prior = np.diag(unknowns.prior)
    changes = [list(own) for own in zip(*(source.changes for source in sources), strict=True)]
    # At first as if every point were independent: from there the sources give back what the noise can explain.
    weigh = about.points / about.independent_points
    states = [
        replace(own, slopes=_with_sources(own.slopes, of_sources), weights=weigh * own.weights)
        for own, of_sources in zip(about.states, changes, strict=True)
    ]
    trial, left = _least(problem, states, unit, unit, prior, model_mm)
    points = _independent(problem, left)
    best, found = unit, _with_weights(problem, states, model_mm)  # as the optimum has it, where nothing explains more
    least = before = _value(unknowns, unit, found, model_mm, points)
    for again in range(_PASSES):
        steps, distance = difference_batch(trial[:n])
        there = freed.evaluate(np.column_stack([steps, np.tile(trial[n:], (len(steps), 1))]), points).comparison
        if there.unconverged.any():
            break
        states = [
            _leaving(replace(own, slopes=_with_sources(_slopes(misfit, distance), of_sources)), misfit.residuals[0])
            for own, misfit, of_sources in zip(left, there.misfits, changes, strict=True)
        ]
        states = _with_weights(problem, states, model_mm)
        value = _value(unknowns, trial, states, model_mm, points)
        if value < least:
            best, found, least = trial, states, value
        if abs(value - before) < _SAME * before or again == _PASSES - 1:
            break
        before = value
        changes = changes_of(freed, trial, [(source.shared, source.part) for source in sources])
        states = [
            replace(own, slopes=_with_sources(own.slopes[:n], of_sources))
            for own, of_sources in zip(states, changes, strict=True)
        ]
        trial, left = _least(problem, states, trial, unit, prior, model_mm)
    hessian = prior + sum((own.information for own in found), np.zeros_like(prior))
    return Explained(tuple(found), hessian, _squares(unknowns, best))


def _value(
    unknowns: Unknowns, unit: Array, states: Sequence[LinearStates], model_mm: Sequence[Array], points: float
) -> float:
    """Minus the logarithm of the likelihood, over N, as a length: see `inference.evidence.objective`."""
    return float(np.concatenate(_with_model(states, model_mm)).mean()) * float(
        np.exp(_squares(unknowns, unit) / (2 * points))
    )


def _slopes(misfit: Misfit, distance: Array) -> Array:
    """(n, K, G, m) by the differences of `difference_batch`."""
    n = len(distance)
    ahead, behind = misfit.residuals[1 : n + 1], misfit.residuals[n + 1 :]
    return np.asarray((ahead - behind) / distance[:, None, None, None])


def _with_sources(slopes: Array, changes: Sequence[Array | None]) -> Array:
    """(n + S, K, G, m), the sources as coordinates from 0 to 1, as if they were freed."""
    return np.concatenate([slopes, [np.zeros(slopes.shape[1:]) if c is None else 2 * RANGE * c for c in changes]])


def _squares(unknowns: Unknowns, unit: Array) -> float:
    return float((unknowns.standardised(unit[None]) ** 2).sum())


def _least(
    problem: Problem,
    states: Sequence[LinearStates],
    at: Array,
    unit: Array,
    prior: Array,
    model_mm: Sequence[Array],
) -> tuple[Array, list[LinearStates]]:
    """Where the residuals, which are those ``at`` (n + S,), are least with the priors about ``unit``; the states there.

    Level and correlation of the noise, and with them the weights, are found on the way.
    """
    left, level, best = list(states), np.inf, at
    for _ in range(_ROUNDS):
        normal, score = prior.copy(), prior @ (at - unit)
        for own, now in zip(states, left, strict=True):
            normal += replace(own, weights=now.weights).information
            score += replace(own, weights=now.weights).score(own.residuals)
        best = at + step_to_minimum(at, score, normal)
        residuals = [own.residuals + np.tensordot(best - at, own.slopes, axes=1) for own in states]
        left = [_leaving(now, own) for now, own in zip(left, residuals, strict=True)]
        left = _with_weights(problem, left, model_mm)
        mean = _mean_mm(left)
        if abs(mean - level) < _SAME * level:
            break
        level = mean
    return best, left


def _with_weights(problem: Problem, states: Sequence[LinearStates], model_mm: Sequence[Array]) -> list[LinearStates]:
    """With the weights that level and correlation of the residuals ask for."""
    errors = _with_model(states, model_mm)
    scale = _independent(problem, states) / float(np.concatenate(errors).sum())
    return [
        replace(own, weights=scale / (np.maximum(own.counts, 1e-12) * error))
        for own, error in zip(states, errors, strict=True)
    ]


def _with_model(states: Sequence[LinearStates], model_mm: Sequence[Array]) -> list[Array]:
    """(K,) of each experiment."""
    return [np.hypot(own.error_mm, model) for own, model in zip(states, model_mm, strict=True)]


def _leaving(own: LinearStates, residuals: Array) -> LinearStates:
    error = np.sqrt((residuals**2).sum(axis=(1, 2)) / np.maximum(own.counts, 1e-12))
    return replace(own, residuals=residuals, error_mm=np.maximum(error, 1e-12))
