"""Separate the residuals of a fit into noise and errors of uncertain inputs, such as the width."""

# The change dx of the unknowns x and the errors s of the inputs, in standard uncertainties, are fitted together:
#
#     minimise  sum_k w_k |r_k + J_k dx + C_k s|^2 + |s|^2 + the priors on x
#
# for the residuals r_k of load case k in mm, their derivatives J_k in x, their changes C_k for one standard uncertainty
# of each input, and the weights w_k (`inference.interval.covariance`). The remaining residuals are the noise.

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.path import Shapes
from eimi_fitting.inference.evidence._quadratic import step_to_minimum
from eimi_fitting.inference.evidence.corrections import Correction
from eimi_fitting.inference.evidence.measurements import Misfit
from eimi_fitting.inference.evidence.objective import Evaluation, Problem
from eimi_fitting.inference.evidence.quantity import NORMAL_95
from eimi_fitting.inference.evidence.sources import SOURCES
from eimi_fitting.inference.evidence.unknowns import RANGE, Unknowns
from eimi_fitting.inference.interval.considered import ConsideredInput, changes_of, considered, sources_of
from eimi_fitting.inference.interval.covariance import Linearisation, LinearStates, linearise, point_correlation
from eimi_fitting.inference.searching.polish import Optimum, difference_batch

Array = NDArray[np.float64]

_ROUNDS = 12  # largest number of fits with renewed weights
_SAME = 0.01  # relative change of the noise at which the fits have converged
_PASSES = 3  # largest number of Gauss-Newton steps, each with renewed slopes


@dataclass(frozen=True)
class Explained:
    """The residuals that remain after the unknowns and the uncertain inputs were fitted together."""

    # There are n unknowns and S inputs.

    # The residuals of each experiment, with derivatives in the unknowns and then in the inputs.
    states: tuple[LinearStates, ...]
    # (n + S, n + S): Hessian of minus the logarithm of the likelihood times the priors.
    hessian: Array
    # Sum of the squared errors of the inputs, in standard uncertainties.
    squares: float


@dataclass(frozen=True)
class Effect:
    """How much the fitted values change if a more accurate beam model, such as a finer mesh, is used."""

    # The change of the residuals by the accurate model.
    correction: Correction
    # (n,): change of the fitted values, scaled to 0..1 between their bounds.
    moved: Array
    # Error that the fitted values still have with the accurate model, divided by `moved`.
    share: float | None = None
    # Lower limit of the 95 % bound of the error of the modulus in per cent.
    least_percent: float = 0.0

    @property
    def remaining_share(self) -> float:
        """The error of the fitted values with the accurate beam model, divided by their change by this model."""
        return self.correction.refinement.remaining_share if self.share is None else self.share


@dataclass(frozen=True)
class Noise:
    """The residuals of a fit near the optimum, and the part of them that is noise."""

    # The residuals as linear functions of the unknowns.
    about: Linearisation
    # The residuals after a joint fit with the inputs `sources`; these are the noise.
    explained: Explained
    sources: tuple[ConsideredInput, ...]
    # Mean standard deviation of the error of the beam model.
    mean_model_mm: float = 0.0

    def not_considered(self, problem: Problem) -> tuple[str, ...]:
        """Return a warning for each uncertain input whose effect the intervals do not contain."""
        return tuple(
            (
                f"the intervals do not contain the uncertainty of the {SOURCES[group.source].words}: no equilibrium "
                "was found for a deviation from the given value"
            )
            for group in sources_of(problem)
            if group not in {source.shared for source in self.sources}
        )


def linearise_noise(problem: Problem, optimum: Optimum[Evaluation], effects: Sequence[Effect] = ()) -> Noise:
    """Separate the residuals of a fit into noise and errors of uncertain inputs."""
    # `effects` also give the remaining error of the beam model.
    about, sources = linearise(problem, optimum), considered(problem, optimum.unit)
    if not sources:
        return Noise(about, Explained(about.states, about.hessian, float((about.priors**2).sum())), ())
    # The intervals already contain the effect of an error of an input on the estimate. If the residuals due to this
    # error also counted as noise, the error would count twice.
    model_mm = _model_mm(optimum, effects)
    explained = _explained(problem, about, sources, model_mm, optimum.evaluation.comparison.near)
    points = _independent(problem, explained.states)
    noise_mm = _mean_mm(explained.states)
    # A weight in the likelihood is proportional to N / E^2, with N points and the mean error E of all residuals. N (E /
    # e)^2 in place of N gives N / e^2, with the mean error e of the noise alone.
    about = linearise(problem, optimum, points * (_mean_mm(about.states) / noise_mm) ** 2)
    variance = about.score_variance
    for states, clean, experiment in zip(about.states, explained.states, problem.experiments, strict=True):
        noise = replace(states, residuals=clean.residuals, error_mm=clean.error_mm)
        variance = variance - states.score_variance(experiment.observed) + noise.score_variance(experiment.observed)
    about = replace(about, score_variance=variance, noise_points=points, noise_mm=noise_mm)
    return Noise(about, explained, sources, float(np.concatenate(model_mm).mean()))


def _model_mm(optimum: Optimum[Evaluation], effects: Sequence[Effect]) -> list[Array]:
    # (K,) for each experiment: standard deviation of the error of the beam model.
    model_mm = []
    for index, misfit in enumerate(optimum.evaluation.comparison.misfits):
        counts = np.maximum(misfit.weights.sum(axis=(1, 2)), 1.0)
        squares = [
            (effect.remaining_share / NORMAL_95) ** 2
            * (effect.correction.changes[index] ** 2).sum(axis=(1, 2))
            / counts
            for effect in effects
        ]
        model_mm.append(np.sqrt(sum(squares, np.zeros(len(counts)))))
    return model_mm


def _mean_mm(states: Sequence[LinearStates]) -> float:
    # The mean over all load cases of the root mean square residual.
    return float(np.mean(np.concatenate([linear.error_mm for linear in states])))


def _independent(problem: Problem, states: Sequence[LinearStates]) -> float:
    # The number of points of all experiments that count as independent.
    return sum(
        float(linear.used.sum()) / point_correlation(linear.residuals, linear.used, experiment.observed)
        for linear, experiment in zip(states, problem.experiments, strict=True)
    )


def _explained(
    problem: Problem,
    about: Linearisation,
    sources: Sequence[ConsideredInput],
    model_mm: Sequence[Array],
    near: Sequence[Shapes],
) -> Explained:
    # Fit unknowns and uncertain inputs together.
    unknowns = Unknowns(problem.unknowns.space, (*problem.unknowns.freed, *(source.freed for source in sources)))
    freed = replace(problem, unknowns=unknowns)
    unit, n = np.concatenate([about.unit, np.full(len(sources), 0.5)]), len(about.unit)
    prior = np.diag(unknowns.prior)
    changes = [list(of_experiment) for of_experiment in zip(*(source.changes for source in sources), strict=True)]
    # The first weights take every point as independent, so that the uncertain inputs explain as much of the residuals
    # as possible. With later weights they explain less, and more of the residuals counts as noise.
    points_per_independent = about.points / about.independent_points
    states = [
        replace(
            linear, slopes=_with_sources(linear.slopes, of_sources), weights=points_per_independent * linear.weights
        )
        for linear, of_sources in zip(about.states, changes, strict=True)
    ]
    trial, remaining = _least(problem, states, unit, unit, prior, model_mm)
    points = _independent(problem, remaining)
    best, best_states = unit, _with_weights(problem, states, model_mm)  # the optimum itself, unless a pass is better
    least = before = _value(unknowns, unit, best_states, model_mm, points)
    # The effect of an input on the residuals is only approximately linear, and an error of a few per cent of this
    # effect may exceed the noise. Residuals and slopes are therefore evaluated again (Gauss-Newton).
    for pass_index in range(_PASSES):
        steps, distance = difference_batch(trial[:n])
        candidates = np.column_stack([steps, np.tile(trial[n:], (len(steps), 1))])
        comparison = freed.evaluate(candidates, points, near=near).comparison
        if comparison.unconverged.any():
            break
        states = [
            _with_residuals(
                replace(linear, slopes=_with_sources(_slopes(misfit, distance), of_sources)), misfit.residuals[0]
            )
            for linear, misfit, of_sources in zip(remaining, comparison.misfits, changes, strict=True)
        ]
        states = _with_weights(problem, states, model_mm)
        value = _value(unknowns, trial, states, model_mm, points)
        if value < least:
            best, best_states, least = trial, states, value
        if abs(value - before) < _SAME * before or pass_index == _PASSES - 1:
            break
        before = value
        changes = changes_of(freed, trial, [(source.shared, source.part) for source in sources])
        states = [
            replace(linear, slopes=_with_sources(linear.slopes[:n], of_sources))
            for linear, of_sources in zip(states, changes, strict=True)
        ]
        trial, remaining = _least(problem, states, trial, unit, prior, model_mm)
    hessian = prior + sum((linear.information for linear in best_states), np.zeros_like(prior))
    return Explained(tuple(best_states), hessian, _squares(unknowns, best))


def _value(
    unknowns: Unknowns, unit: Array, states: Sequence[LinearStates], model_mm: Sequence[Array], points: float
) -> float:
    # The objective (mm) of the joint fit. `unit` are the scaled unknowns, and `points` is the number of independent
    # points.
    # The likelihood is proportional to this number to the power -points.
    return float(np.concatenate(_with_model(states, model_mm)).mean()) * float(
        np.exp(_squares(unknowns, unit) / (2 * points))
    )


def _slopes(misfit: Misfit, distance: Array) -> Array:
    # Central differences by the n unknowns, scaled to 0..1.
    n = len(distance)
    # The residuals belong to the optimum, then to n increased and n decreased values of one unknown each.
    ahead, behind = misfit.residuals[1 : n + 1], misfit.residuals[n + 1 :]
    return np.asarray((ahead - behind) / distance[:, None, None, None])


def _with_sources(slopes: Array, changes: Sequence[Array | None]) -> Array:
    # Append the derivatives by the uncertain inputs to those by the unknowns.
    # An input scaled to 0..1 covers 2 * RANGE standard uncertainties.
    return np.concatenate([slopes, [np.zeros(slopes.shape[1:]) if c is None else 2 * RANGE * c for c in changes]])


def _squares(unknowns: Unknowns, unit: Array) -> float:
    # The sum of the squared deviations of the inputs from their specified values, in standard uncertainties.
    return float((unknowns.standardised(unit[None]) ** 2).sum())


def _least(
    problem: Problem,
    states: Sequence[LinearStates],
    at: Array,
    unit: Array,
    prior: Array,
    model_mm: Sequence[Array],
) -> tuple[Array, list[LinearStates]]:
    # Returns the fitted values and the remaining residuals.
    # The residuals are linear about ``at``. The priors have the mean ``unit`` and the inverse variance ``prior``.
    remaining, level, best = list(states), np.inf, at
    for _ in range(_ROUNDS):
        normal, score = prior.copy(), prior @ (at - unit)
        for linear, weighted in zip(states, remaining, strict=True):
            normal += replace(linear, weights=weighted.weights).information
            score += replace(linear, weights=weighted.weights).score(linear.residuals)
        best = at + step_to_minimum(at, score, normal)
        residuals = [linear.residuals + np.tensordot(best - at, linear.slopes, axes=1) for linear in states]
        remaining = [_with_residuals(weighted, r) for weighted, r in zip(remaining, residuals, strict=True)]
        # The weights depend on the residuals that remain.
        remaining = _with_weights(problem, remaining, model_mm)
        mean = _mean_mm(remaining)
        if abs(mean - level) < _SAME * level:
            break
        level = mean
    return best, remaining


def _with_weights(problem: Problem, states: Sequence[LinearStates], model_mm: Sequence[Array]) -> list[LinearStates]:
    # The weights follow from the size of the residuals and from the error of the beam model.
    errors = _with_model(states, model_mm)
    scale = _independent(problem, states) / float(np.concatenate(errors).sum())
    return [
        replace(linear, weights=scale / (np.maximum(linear.counts, 1e-12) * error))
        for linear, error in zip(states, errors, strict=True)
    ]


def _with_model(states: Sequence[LinearStates], model_mm: Sequence[Array]) -> list[Array]:
    # The error of each load case in mm, from its residuals and the error of the beam model.
    return [np.hypot(linear.error_mm, model) for linear, model in zip(states, model_mm, strict=True)]


def _with_residuals(states: LinearStates, residuals: Array) -> LinearStates:
    error = np.sqrt((residuals**2).sum(axis=(1, 2)) / np.maximum(states.counts, 1e-12))
    return replace(states, residuals=residuals, error_mm=np.maximum(error, 1e-12))
