"""The evidence linearised about an optimum: what it fixes, and how far its noise moves the optimum.

With w_k the weight of state k's residuals in the objective (`eimi_fitting.problem`), J their slopes and r the noise:

information      A = sum w_k J'J, the curvature of the objective
noise's pull     B = the variance of sum w_k J'r, points that are alike counting as tau of one
covariance       inv(A + P) (B + P) inv(A + P), P the inverse variance of the priors

the sandwich of an estimator whose weights are not quite the inverse of its noise (Huber 1967, Proc. 5th Berkeley
Symp. 1:221; White 1982, Econometrica 50:1). Where all states are equally noisy A is B.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.correlation import correlation_length
from eimi_fitting.nuisance import RANGE
from eimi_fitting.observation import EdgeObservation, Misfit, Observation
from eimi_fitting.polish import difference_batch
from eimi_fitting.problem import Problem

Array = NDArray[np.float64]

BOUNDS_VARIANCE = 1.0 / 12.0  # of a uniform distribution over the unit interval


@dataclass(frozen=True)
class Linearised:
    """About ``unit`` (n,), with the objective there.

    One an experiment: residuals (K, G, m) mm, slopes (n, K, G, m) mm, weights (K,) of w_k, counts (K,) of points.

    points: number of points; independent_points: N; noise_mm: residual standard deviation; curves (m,) and curve_slopes
    (n, m): standardised residuals of the tensile curves; priors: those of the freed nuisances; information, pull and
    prior: A, B and P (n, n).
    """

    unit: Array
    objective_mm: float
    residuals: tuple[Array, ...]
    slopes: tuple[Array, ...]
    weights: tuple[Array, ...]
    counts: tuple[Array, ...]
    points: int
    independent_points: float
    noise_mm: float
    curves: Array
    curve_slopes: Array
    priors: Array
    information: Array
    pull: Array
    prior: Array

    @property
    def curvature(self) -> Array:
        """A + P (n, n)."""
        return self.information + self.prior

    @property
    def gradient(self) -> Array:
        """(n,): half the gradient of the objective's rise; zero at an optimum that no bound holds."""
        searched = len(self.unit) - len(self.priors)
        total = self.curve_slopes @ self.curves
        for residual, slope, weight in zip(self.residuals, self.slopes, self.weights, strict=True):
            total = total + np.einsum("k,ikgn,kgn->i", weight, slope, residual)
        total[searched:] += self.priors * np.sqrt(np.diag(self.prior)[searched:])
        return np.asarray(total)

    def covariance(self, widened: float = 1.0) -> Array:
        """(n, n) of the optimum, with the noise's standard deviation taken for ``widened`` times what it seems."""
        inverse = np.linalg.inv(self.curvature)
        return np.asarray(inverse @ (widened**2 * self.pull + self.prior) @ inverse)


def point_correlation(residuals: Array, weights: Array, seen: Observation) -> float:
    """How many points of an experiment count as one.

    Along an edge and from state to state by their own correlation: what the lens, the light or the law get wrong is
    much alike in neighbouring states. Tracked points carry an uncertainty that is taken as common to the points of one
    state, of which two components are left.
    """
    if isinstance(seen, EdgeObservation):
        by_state = correlation_length(residuals.transpose(1, 2, 0), weights.transpose(1, 2, 0))
        return correlation_length(residuals, weights) * by_state
    return max(float(weights.sum()) / (2 * len(weights)), 1.0)


def independent_points(problem: Problem, misfits: tuple[Misfit, ...]) -> float:
    """N of the first candidate of a comparison."""
    return sum(
        float(m.weights.sum()) / point_correlation(m.residuals[0], m.weights, e.observed)
        for m, e in zip(misfits, problem.experiments, strict=True)
    )


def linearise(problem: Problem, unit: Array) -> Linearised:
    """One batch of 2 n + 1 candidates at and about ``unit`` (n,)."""
    n, searched = len(unit), problem.searched
    batch, distance = difference_batch(unit)
    judged = problem.judge(batch, 1.0)
    misfits = judged.comparison.misfits
    mean = float(judged.comparison.error_mm[0].mean())
    states = judged.comparison.error_mm.shape[1]
    counted = independent_points(problem, misfits)
    scale = counted / (states * max(mean, 1e-12))
    information, pull = np.zeros((n, n)), np.zeros((n, n))
    residuals, slopes, weights, counts = [], [], [], []
    for misfit, experiment in zip(misfits, problem.experiments, strict=True):
        r, used = misfit.residuals[0], misfit.weights
        slope = (misfit.residuals[1 : n + 1] - misfit.residuals[n + 1 :]) / distance[:, None, None, None]
        tau = point_correlation(r, used, experiment.observed)
        error = np.maximum(misfit.error_mm[0], 1e-12)
        count = used.sum(axis=(1, 2))
        weight = scale / (np.maximum(count, 1e-12) * error)
        by_state = np.einsum("ikgn,jkgn->kij", slope, slope)
        information += np.einsum("k,kij->ij", weight, by_state)
        if isinstance(experiment.observed, EdgeObservation):
            pull += np.einsum("k,kij->ij", tau * (weight * error) ** 2, by_state)
        else:
            # Two components share a point's error; what its residuals show beyond the stated uncertainty counts too.
            seen = used > 0
            sigma = np.where(np.isfinite(experiment.observed.sigma_mm), experiment.observed.sigma_mm, 0.0)[:, None]
            stated = (seen * sigma**2).sum(axis=(1, 2)) / np.maximum(seen.sum(axis=(1, 2)), 1)
            together = slope.sum(axis=-1)  # of a shift that is common to the points of a state
            variance = np.maximum(stated, 0.5 * error**2)
            pull += np.einsum("k,ikg,jkg->ij", weight**2 * variance, together, together)
        residuals.append(r)
        slopes.append(slope)
        weights.append(weight)
        counts.append(count)
    m = judged.standardised.shape[1] - len(problem.freed)
    z = judged.standardised[:, :m]
    curve_slopes = (z[1 : n + 1] - z[n + 1 :]) / distance[:, None]
    information += curve_slopes @ curve_slopes.T
    first = 0
    for curve in problem.curves:
        own = slice(first, first + len(curve.curve.strain))
        first = own.stop
        # Its noise as it is here, where the edges pull at the law, not as it is alone; sum z^2 of m rows is m / tau.
        seen_square = float((z[0, own] ** 2).sum()) * curve.correlation_rows / len(curve.curve.strain)
        pull += max(curve.curve.weight, seen_square) * curve_slopes[:, own] @ curve_slopes[:, own].T
    points = sum(float(count.sum()) for count in counts)
    square = sum(float((r**2).sum()) for r in residuals)
    prior = np.full(n, 1 / BOUNDS_VARIANCE)
    prior[searched:] = (2 * RANGE) ** 2
    return Linearised(
        unit,
        float(replace(judged, independent_points=counted).objective_mm[0]),
        tuple(residuals),
        tuple(slopes),
        tuple(weights),
        tuple(counts),
        round(points),
        counted,
        float(np.sqrt(square / max(points, 1.0))),
        z[0],
        curve_slopes,
        judged.standardised[0, m:],
        information,
        pull,
        np.diag(prior),
    )


def held_out_error_mm(about: Linearised, folds: int = 5) -> float:
    """Mean error of states that the fit has not seen.

    Every so-many-th state is left out in turn (Hastie, Tibshirani, Friedman 2009, The Elements of Statistical Learning,
    section 7.10), the rest fitted by one Gauss-Newton step, the errors taken from the same linearisation.
    """
    states = [(d, k) for d, r in enumerate(about.residuals) for k in range(len(r))]
    folds = min(folds, len(states))
    errors = []
    for fold in range(folds):
        left_out = states[fold::folds]
        curvature, pull = about.curvature.copy(), np.zeros(len(about.unit))
        for d, k in left_out:
            slope, weight = about.slopes[d][:, k], about.weights[d][k]
            curvature -= weight * np.einsum("ign,jgn->ij", slope, slope)
            pull += weight * np.einsum("ign,gn->i", slope, about.residuals[d][k])
        step = np.linalg.solve(curvature, pull)
        for d, k in left_out:
            residual = about.residuals[d][k] + np.einsum("i,ign->gn", step, about.slopes[d][:, k])
            errors.append(float(np.sqrt((residual**2).sum() / max(about.counts[d][k], 1.0))))
    return float(np.mean(errors))
