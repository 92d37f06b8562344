"""The evidence linearised about an optimum: what it fixes, and how far its noise moves the optimum.

With w_k the weight of state k's residuals in the objective (`inference.evidence.objective`), J their slopes and r the
noise:

information          A = sum w_k J'J, the Hessian of the objective
variance of score    B = the variance of sum w_k J'r, points that are alike counting as tau of one
covariance           inv(A + P) (B + P) inv(A + P), P the inverse variance of the priors

the sandwich of an estimator whose weights are not quite the inverse of its noise (Huber 1967, Proc. 5th Berkeley
Symp. 1:221; White 1982, Econometrica 50:1). Where all states are equally noisy A is B.
"""

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
    """The K states of one experiment about an optimum.

    residuals: (K, G, m) mm; slopes: (n, K, G, m) mm; used: (K, G, m) above zero where a point counts; weights: (K,) of
    w_k; counts: (K,) of points; error_mm: (K,).
    """

    residuals: Array
    slopes: Array
    used: Array
    weights: Array
    counts: Array
    error_mm: Array

    @property
    def information(self) -> Array:
        """(n, n)."""
        return np.asarray(np.einsum("k,kij->ij", self.weights, self._by_state()))

    def score(self, residuals: Array) -> Array:
        """(n,) of residuals (K, G, m)."""
        return np.asarray(np.einsum("k,ikgn,kgn->i", self.weights, self.slopes, residuals))

    def score_variance(self, observed: Observation) -> Array:
        """(n, n): what is observed tells which points are alike."""
        if isinstance(observed, EdgeObservation):
            tau = point_correlation(self.residuals, self.used, observed)
            return np.asarray(np.einsum("k,kij->ij", tau * (self.weights * self.error_mm) ** 2, self._by_state()))
        # Two components share a point's error; what its residuals show beyond the stated uncertainty counts too.
        seen = self.used > 0
        sigma = np.where(np.isfinite(observed.sigma_mm), observed.sigma_mm, 0.0)[:, None]
        stated = (seen * sigma**2).sum(axis=(1, 2)) / np.maximum(seen.sum(axis=(1, 2)), 1)
        together = self.slopes.sum(axis=-1)  # of a shift that is common to the points of a state
        variance = np.maximum(stated, 0.5 * self.error_mm**2)
        return np.asarray(np.einsum("k,ikg,jkg->ij", self.weights**2 * variance, together, together))

    def _by_state(self) -> Array:
        return np.asarray(np.einsum("ikgn,jkgn->kij", self.slopes, self.slopes))


@dataclass(frozen=True)
class Linearisation:
    """The evidence about ``unit`` (n,), with the objective there, the priors on the law's parameters left out.

    states: one an experiment; points: number of points; independent_points: N;
    likelihood_points, noise_points, noise_mm: as many as the likelihood takes, and N and standard deviation of the
    noise alone, see `inference.interval.noise`; residual_mm: residual standard deviation;
    curves (m,) and curve_slopes (n, m): standardised residuals of the tensile curves; priors: (f,) those of the freed
    nuisances; known (q,) and known_slopes (n, q): those of the priors on the law's parameters; information,
    score_variance and prior: A, B and P (n, n), P without the priors on the law's parameters.
    """

    unit: Array
    objective_mm: float
    states: tuple[LinearStates, ...]
    points: int
    independent_points: float
    likelihood_points: float
    noise_points: float
    noise_mm: float
    residual_mm: float
    curves: Array
    curve_slopes: Array
    priors: Array
    known: Array
    known_slopes: Array
    information: Array
    score_variance: Array
    prior: Array

    @property
    def known_information(self) -> Array:
        """(n, n): what the priors on the law's parameters add to P."""
        return np.asarray(self.known_slopes @ self.known_slopes.T)

    @property
    def hessian(self) -> Array:
        """A + P (n, n)."""
        return self.information + self.prior + self.known_information

    @property
    def score(self) -> Array:
        """(n,): the gradient of minus the log-likelihood; zero at an optimum that no bound holds."""
        total = self.curve_slopes @ self.curves + self.known_slopes @ self.known
        for own in self.states:
            total = total + own.score(own.residuals)
        return self._with_priors(np.asarray(total)[None], self.priors[None])[0]

    def score_of(self, candidates: Evaluation) -> Array:
        """(P, n): of other candidates, without the priors on the law's parameters.

        Slopes are those of the optimum, weights those of the candidates' own errors.
        """
        total = candidates.curves @ self.curve_slopes.T
        for own, misfit in zip(self.states, candidates.comparison.misfits, strict=True):
            here = np.sqrt((own.residuals**2).sum(axis=(1, 2)) / np.maximum(own.counts, 1e-12))
            weight = own.weights * here / np.maximum(misfit.error_mm, 1e-12)
            total = total + np.einsum("pk,ikgn,pkgn->pi", weight, own.slopes, misfit.residuals)
        return self._with_priors(total, candidates.priors)

    def _with_priors(self, score: Array, priors: Array) -> Array:
        searched = len(self.unit) - len(self.priors)
        score[:, searched:] += priors * np.sqrt(np.diag(self.prior)[searched:])
        return score

    def prior_distances(self) -> tuple[float, ...]:
        """Return how far the optimum without each prior lies from its mean, in deviations of both together.

        The optimum without a prior is that of the quadratic about this one: a prior whose standardised residual is z
        there has z (1 + s' inv(H) s), H the Hessian without it and s its slope, and that number's own variance is
        1 + s' inv(H) s where prior and data agree.
        """
        found = []
        for z, slope in zip(self.known, self.known_slopes.T, strict=True):
            others = self.hessian - np.outer(slope, slope)
            found.append(float(z * np.sqrt(1 + slope @ np.linalg.solve(others, slope))))
        return tuple(found)

    def covariance(self, widened: float = 1.0) -> Array:
        """(n, n) of the optimum, with the noise's standard deviation taken for ``widened`` times what it seems."""
        inverse = np.linalg.inv(self.hessian)
        return np.asarray(inverse @ (widened**2 * self.score_variance + self.prior + self.known_information) @ inverse)


def point_correlation(residuals: Array, weights: Array, observed: Observation) -> float:
    """How many points of an experiment count as one.

    Along an edge and from state to state by their own correlation: what the lens, the light or the law get wrong is
    much alike in neighbouring states. Tracked points carry an uncertainty that is taken as common to the points of one
    state, of which two components are left.
    """
    if isinstance(observed, EdgeObservation):
        by_state = correlation_length(residuals.transpose(1, 2, 0), weights.transpose(1, 2, 0))
        return correlation_length(residuals, weights) * by_state
    return max(float(weights.sum()) / (2 * len(weights)), 1.0)


def independent_points(problem: Problem, misfits: tuple[Misfit, ...]) -> float:
    """N of the first candidate of a comparison."""
    return sum(
        float(m.weights.sum()) / point_correlation(m.residuals[0], m.weights, e.observed)
        for m, e in zip(misfits, problem.experiments, strict=True)
    )


def linearise(problem: Problem, optimum: Optimum[Evaluation], likelihood_points: float | None = None) -> Linearisation:
    """What the evaluation about an optimum of this problem says; the likelihood takes N points, or so many."""
    here, distance = optimum.evaluation, optimum.distance
    n, misfits = len(optimum.unit), here.comparison.misfits
    counted = independent_points(problem, misfits)
    mean, count = float(here.comparison.error_mm[0].mean()), here.comparison.error_mm.shape[1]
    taken = counted if likelihood_points is None else likelihood_points
    scale = taken / (count * max(mean, 1e-12))
    states = tuple(_linear_states(misfit, distance, scale) for misfit in misfits)
    curve_slopes, known_slopes = ((z[1 : n + 1] - z[n + 1 :]) / distance[:, None] for z in (here.curves, here.known))
    variance = np.zeros((n, n))
    for own, experiment in zip(states, problem.experiments, strict=True):
        variance += own.score_variance(experiment.observed)
    points = sum(float(own.counts.sum()) for own in states)
    square = sum(float((own.residuals**2).sum()) for own in states)
    return Linearisation(
        unit=optimum.unit,
        objective_mm=float(replace(here.without_known, independent_points=taken).objective_mm[0]),
        states=states,
        points=round(points),
        independent_points=counted,
        likelihood_points=taken,
        noise_points=counted,
        noise_mm=mean,
        residual_mm=float(np.sqrt(square / max(points, 1.0))),
        curves=here.curves[0],
        curve_slopes=curve_slopes,
        priors=here.priors[0],
        known=here.known[0],
        known_slopes=known_slopes,
        information=sum((own.information for own in states), np.zeros((n, n))) + curve_slopes @ curve_slopes.T,
        score_variance=variance + _curves_score_variance(problem, here.curves[0], curve_slopes),
        prior=np.diag(problem.unknowns.prior),
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
    """(n, n) of tensile curves, with the noise as it is here, where the edges pull at the law, not as it is alone."""
    variance = np.zeros((len(slopes), len(slopes)))
    first = 0
    for curve in problem.curves:
        own = slice(first, first + len(curve.curve.strain))
        first = own.stop
        # sum z^2 of m rows is m / tau
        square = float((z[own] ** 2).sum()) * curve.correlation_rows / len(curve.curve.strain)
        variance += max(curve.curve.weight, square) * slopes[:, own] @ slopes[:, own].T
    return variance
