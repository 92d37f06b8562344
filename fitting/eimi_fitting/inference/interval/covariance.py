"""Compute the covariance of the fitted values from the derivatives of the residuals."""

# The covariance of the optimum is (White 1982, Econometrica 50:1)
#
#     C = inv(A + P) (B + P) inv(A + P)
#
# with the Hessian A of minus the log-likelihood, the covariance B of its gradient, and the inverse prior covariance P:
#
#     A = sum_k w_k J_k' J_k,    B = sum_k tau w_k^2 e_k^2 J_k' J_k,    w_k = N / (K e N_k e_k)
#
# Load case k of K has N_k points, the derivatives J_k of its residuals in the unknowns, and the root mean square
# residual e_k; e is the mean of all e_k. Neighbouring residuals are correlated: tau points count as one independent
# point, and N is the number of independent points in all load cases together. The weight w_k makes all load cases
# count equally.

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.correlation import correlation_length
from eimi_fitting.inference.evidence.measurements import EdgeObservation, Misfit, Observation
from eimi_fitting.inference.evidence.objective import Evaluation, Problem
from eimi_fitting.inference.searching.polish import Optimum

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LinearStates:
    """The residuals of one experiment, as linear functions of the unknowns of a fit."""

    # There are K load cases, m points on each of two edges (or m tracked points in x and y), and n unknowns.

    # (K, 2, m): in mm.
    residuals: Array
    # (n, K, 2, m): derivatives of the residuals in mm, in the unknowns scaled to 0..1 between their bounds.
    slopes: Array
    # (K, 2, m): zero for points that are not used.
    used: Array
    # (K,): weight of the squared residuals in the likelihood, in 1/mm^2.
    weights: Array
    # (K,): number of points.
    counts: Array
    # (K,): root mean square residual.
    error_mm: Array

    @property
    def information(self) -> Array:
        """The Hessian of minus the log-likelihood of this experiment."""
        return np.asarray(np.einsum("k,kij->ij", self.weights, self._by_state()))

    def score(self, residuals: Array) -> Array:
        """Return the gradient of minus the log-likelihood in the unknowns of the fit, for given residuals (mm)."""
        return np.asarray(np.einsum("k,ikgn,kgn->i", self.weights, self.slopes, residuals))

    def score_variance(self, observed: Observation) -> Array:
        """Return the covariance matrix of the gradient of the log-likelihood."""
        if isinstance(observed, EdgeObservation):
            # sum over the states of tau w^2 e^2 J'J: weight w, error e, slopes J, and tau points as one independent
            # point
            tau = point_correlation(self.residuals, self.used, observed)
            return np.asarray(np.einsum("k,kij->ij", tau * (self.weights * self.error_mm) ** 2, self._by_state()))
        # All points of a state are assumed to have one common error in x and one in y.
        # Half of a point's squared error belongs to each of its two components. The residuals count if they are larger
        # than the stated uncertainty.
        is_used = self.used > 0
        sigma = np.where(np.isfinite(observed.sigma_mm), observed.sigma_mm, 0.0)[:, None]
        stated = (is_used * sigma**2).sum(axis=(1, 2)) / np.maximum(is_used.sum(axis=(1, 2)), 1)
        shift_slopes = self.slopes.sum(axis=-1)  # for one shift of all points of a state
        variance = np.maximum(stated, 0.5 * self.error_mm**2)
        return np.asarray(np.einsum("k,ikg,jkg->ij", self.weights**2 * variance, shift_slopes, shift_slopes))

    def _by_state(self) -> Array:
        return np.asarray(np.einsum("ikgn,jkgn->kij", self.slopes, self.slopes))


@dataclass(frozen=True)
class Linearisation:
    """The residuals of a fit to edges, tensile curves and priors, as linear functions of the unknowns."""

    # There are n unknowns, scaled to 0..1 between their bounds.

    # (n,): fitted values.
    unit: Array
    # The minimum of the objective.
    objective_mm: float
    states: tuple[LinearStates, ...]
    # Number of measured points, and number of independent points, from the correlation of all residuals.
    points: int
    independent_points: float
    # The number N in the weights. It is larger than `independent_points` if only a part of the residuals is noise.
    likelihood_points: float
    # Number of independent points, from the correlation of the noise.
    noise_points: float
    # Mean over the load cases of the root mean square noise.
    noise_mm: float
    # Root mean square of all residuals.
    residual_mm: float
    # (m,) and (n, m): residuals of m points of the tensile curves, in standard deviations, and their derivatives.
    curves: Array
    curve_slopes: Array
    # (f,): deviations of f fitted inputs, in standard deviations of their priors.
    priors: Array
    # (q,) and (n, q): residuals of q priors on the law's parameters, in standard deviations, and their derivatives.
    law_priors: Array
    law_prior_slopes: Array
    # (n, n): Hessian of minus the log-likelihood, covariance of its gradient, inverse covariance of the priors.
    information: Array
    score_variance: Array
    prior: Array

    @property
    def law_prior_information(self) -> Array:
        """The Hessian of minus the logarithm of the priors on the law's parameters."""
        return np.asarray(self.law_prior_slopes @ self.law_prior_slopes.T)

    @property
    def hessian(self) -> Array:
        """The Hessian of minus the logarithm of the likelihood times all priors."""
        return self.information + self.prior + self.law_prior_information

    @property
    def score(self) -> Array:
        """The gradient of minus the logarithm of the likelihood times all priors."""
        total = self.curve_slopes @ self.curves + self.law_prior_slopes @ self.law_priors
        for states in self.states:
            total = total + states.score(states.residuals)
        return self._with_priors(np.asarray(total)[None], self.priors[None])[0]

    def score_of(self, candidates: Evaluation) -> Array:
        """Return the gradient of minus the log-likelihood for several sets of values of the unknowns."""
        # The slopes are those of the optimum, so that no further simulation is needed.
        # The priors on fitted inputs are included, but not the priors on the law's parameters.
        total = candidates.curves @ self.curve_slopes.T
        for states, misfit in zip(self.states, candidates.comparison.misfits, strict=True):
            optimum_error = np.sqrt((states.residuals**2).sum(axis=(1, 2)) / np.maximum(states.counts, 1e-12))
            # The weight of a state is proportional to 1 / error.
            weight = states.weights * optimum_error / np.maximum(misfit.error_mm, 1e-12)
            total = total + np.einsum("pk,ikgn,pkgn->pi", weight, states.slopes, misfit.residuals)
        return self._with_priors(total, candidates.priors)

    def _with_priors(self, score: Array, priors: Array) -> Array:
        searched = len(self.unit) - len(self.priors)
        score[:, searched:] += priors * np.sqrt(np.diag(self.prior)[searched:])
        return score

    def prior_distances(self) -> tuple[float, ...]:
        """Return the distance of each prior from the value fitted without it, in standard deviations."""
        # The standard deviation is that of the difference.
        distances = []
        for z, slope in zip(self.law_priors, self.law_prior_slopes.T, strict=True):
            # Without this prior, its residual at the optimum would be z (1 + s' inv(H) s), with the variance 1 + s'
            # inv(H) s, for its slope s and the Hessian H of all others.
            others = self.hessian - np.outer(slope, slope)
            distances.append(float(z * np.sqrt(1 + slope @ np.linalg.solve(others, slope))))
        return tuple(distances)

    def covariance(self, widened: float = 1.0) -> Array:
        """Return the covariance matrix of the unknowns, for noise that is larger by the factor ``widened``."""
        # `widened` is a factor on the estimated noise.
        # The weights of the load cases differ from the inverse variance of their noise (sandwich covariance: Huber
        # 1967, Proc. 5th Berkeley Symp. 1:221).
        inverse = np.linalg.inv(self.hessian)
        return np.asarray(
            inverse @ (widened**2 * self.score_variance + self.prior + self.law_prior_information) @ inverse
        )


def point_correlation(residuals: Array, weights: Array, observed: Observation) -> float:
    """Return how many neighbouring residuals count as one independent residual, at least 1."""
    # (K, 2, m): residuals in mm, and weights that are zero for points that are not used.
    # Errors of lens, light and law are similar along an edge and in neighbouring states.
    if isinstance(observed, EdgeObservation):
        by_state = correlation_length(residuals.transpose(1, 2, 0), weights.transpose(1, 2, 0))
        return correlation_length(residuals, weights) * by_state
    # One error is assumed common to all points of a state, so that a state has two independent numbers, x and y.
    return max(float(weights.sum()) / (2 * len(weights)), 1.0)


def independent_points(problem: Problem, misfits: tuple[Misfit, ...]) -> float:
    """Return how many measured points count as independent, from the correlation of the residuals."""
    return sum(
        float(m.weights.sum()) / point_correlation(m.residuals[0], m.weights, e.observed)
        for m, e in zip(misfits, problem.experiments, strict=True)
    )


def linearise(problem: Problem, optimum: Optimum[Evaluation], likelihood_points: float | None = None) -> Linearisation:
    """Return the residuals of a fit as linear functions of the unknowns near the optimum."""
    # `likelihood_points` is the number N in the weights, by default the number of independent points.
    evaluation, distance = optimum.evaluation, optimum.distance
    n, misfits = len(optimum.unit), evaluation.comparison.misfits
    counted = independent_points(problem, misfits)
    mean, count = float(evaluation.comparison.error_mm[0].mean()), evaluation.comparison.error_mm.shape[1]
    taken = counted if likelihood_points is None else likelihood_points
    scale = taken / (count * max(mean, 1e-12))
    states = tuple(_linear_states(misfit, distance, scale) for misfit in misfits)
    curve_slopes, law_prior_slopes = (
        (z[1 : n + 1] - z[n + 1 :]) / distance[:, None] for z in (evaluation.curves, evaluation.law_priors)
    )
    variance = np.zeros((n, n))
    for linear, experiment in zip(states, problem.experiments, strict=True):
        variance += linear.score_variance(experiment.observed)
    points = sum(float(linear.counts.sum()) for linear in states)
    square = sum(float((linear.residuals**2).sum()) for linear in states)
    return Linearisation(
        unit=optimum.unit,
        objective_mm=float(replace(evaluation.without_law_priors, independent_points=taken).objective_mm[0]),
        states=states,
        points=round(points),
        independent_points=counted,
        likelihood_points=taken,
        noise_points=counted,
        noise_mm=mean,
        residual_mm=float(np.sqrt(square / max(points, 1.0))),
        curves=evaluation.curves[0],
        curve_slopes=curve_slopes,
        priors=evaluation.priors[0],
        law_priors=evaluation.law_priors[0],
        law_prior_slopes=law_prior_slopes,
        information=sum((linear.information for linear in states), np.zeros((n, n))) + curve_slopes @ curve_slopes.T,
        score_variance=variance + _curves_score_variance(problem, evaluation.curves[0], curve_slopes),
        prior=np.diag(problem.unknowns.prior),  # without the priors on the law's parameters
    )


def _linear_states(misfit: Misfit, distance: Array, scale: float) -> LinearStates:
    n = len(distance)
    error = np.maximum(misfit.error_mm[0], 1e-12)
    counts = misfit.weights.sum(axis=(1, 2))
    return LinearStates(
        residuals=misfit.residuals[0],
        slopes=(misfit.residuals[1 : n + 1] - misfit.residuals[n + 1 :]) / distance[:, None, None, None],
        used=misfit.weights,
        weights=scale / (np.maximum(counts, 1e-12) * error),
        counts=counts,
        error_mm=error,
    )


def _curves_score_variance(problem: Problem, z: Array, slopes: Array) -> Array:
    # The covariance matrix (n, n) of the gradient of the log-likelihood of the tensile curves.
    variance = np.zeros((len(slopes), len(slopes)))
    first = 0
    for curve in problem.curves:
        rows = slice(first, first + len(curve.curve.strain))
        first = rows.stop
        # The expected sum of z^2 over m rows is m / tau.
        square = float((z[rows] ** 2).sum()) * curve.correlation_rows / len(curve.curve.strain)
        # The noise of the joint fit counts, but at least the noise of a fit to the curve alone.
        variance += max(curve.curve.weight, square) * slopes[:, rows] @ slopes[:, rows].T
    return variance
