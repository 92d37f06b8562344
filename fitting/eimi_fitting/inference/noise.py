"""Noise told from stated sources: the evidence linearised, with the noise that the sources do not explain.

What a wrong width leaves along both edges is no noise: it is in the intervals as what it does to the estimate, and
would else be there twice. How much of each source the residuals show is found together with the unknowns by least
squares, with its stated uncertainty as what was known before; level and correlation of the noise are those of the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.considered import ConsideredSources
from eimi_fitting.inference.covariance import Linearisation, LinearStates, linearise, point_correlation
from eimi_fitting.inference.objective import Evaluation, Problem
from eimi_fitting.inference.polish import Optimum

Array = NDArray[np.float64]

_ROUNDS = 12  # at most, in which noise and sources share the residuals
_SAME = 0.01  # of the noise from round to round


def linearise_noise(
    problem: Problem, optimum: Optimum[Evaluation], sources: Sequence[ConsideredSources]
) -> Linearisation:
    """`linearise`, with the noise's level and correlation from what the sources do not explain of the residuals.

    The likelihood takes as many points as make the same noise of what is left: N of the rest, times the square of all
    residuals over those.
    """
    about = linearise(problem, optimum)
    if not sources:
        return about
    left = _unexplained(problem, about, sources)
    points = _independent(problem, left)
    about = linearise(problem, optimum, points * (_mean_mm(about.states) / _mean_mm(left)) ** 2)
    variance = about.score_variance
    for own, clean, experiment in zip(about.states, left, problem.experiments, strict=True):
        noise = replace(clean, weights=own.weights)
        variance = variance - own.score_variance(experiment.observed) + noise.score_variance(experiment.observed)
    return replace(about, score_variance=variance, noise_points=points, noise_mm=_mean_mm(left))


def _mean_mm(states: Sequence[LinearStates]) -> float:
    return float(np.mean(np.concatenate([own.error_mm for own in states])))


def _independent(problem: Problem, states: Sequence[LinearStates]) -> float:
    return sum(
        float(own.used.sum()) / point_correlation(own.residuals, own.used, experiment.observed)
        for own, experiment in zip(states, problem.experiments, strict=True)
    )


def _unexplained(problem: Problem, about: Linearisation, sources: Sequence[ConsideredSources]) -> list[LinearStates]:
    """The states with residuals and errors that unknowns and sources together leave."""
    moves = [
        np.concatenate([own.slopes, [np.zeros_like(own.residuals) if c is None else c for c in changes]])
        for own, changes in zip(about.states, zip(*(s.changes for s in sources), strict=True), strict=True)
    ]
    known = np.diag(np.concatenate([np.diag(about.prior), np.ones(len(sources))]))
    states = list(about.states)
    # At first as if every point were independent: from there the sources give back what the noise can explain.
    weights = [own.weights * about.points / about.independent_points for own in states]
    level = np.inf
    for _ in range(_ROUNDS):
        normal, score = known.copy(), np.zeros(len(known))
        for move, weight, own in zip(moves, weights, about.states, strict=True):
            normal += np.einsum("k,ikgn,jkgn->ij", weight, move, move, optimize=True)
            score += np.einsum("k,ikgn,kgn->i", weight, move, own.residuals, optimize=True)
        best = -np.linalg.solve(normal, score)
        states = []
        for move, own in zip(moves, about.states, strict=True):
            residuals = own.residuals + np.tensordot(best, move, axes=1)
            error = np.sqrt((residuals**2).sum(axis=(1, 2)) / np.maximum(own.counts, 1e-12))
            states.append(replace(own, residuals=residuals, error_mm=np.maximum(error, 1e-12)))
        mean = _mean_mm(states)
        if abs(mean - level) < _SAME * level:
            break
        level = mean
        scale = _independent(problem, states) / (sum(len(own.counts) for own in states) * mean)
        weights = [scale / (np.maximum(own.counts, 1e-12) * own.error_mm) for own in states]
    return states
