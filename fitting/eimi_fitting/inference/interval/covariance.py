"""Linearise the evidence of a fit (edges, tensile curves, priors) about its optimum, and compute the covariance there.

State k has N_k points. Its residuals r_k have the root mean square e_k and the derivatives (slopes) J_k = dr_k/dx in
the unknowns x. K is the number of states, e the mean of the errors e_k, and N the number of independent points
(`inference.evidence.objective`). In the likelihood, the squared residuals of state k have the weight

    w_k = N / (K e N_k e_k).

Neighbouring points have similar errors: tau points count as one independent point (`point_correlation`). The data have
the information A, and the score (the gradient of minus the log-likelihood) has the variance B:

    A = sum_k w_k J_k' J_k,    B = sum_k tau w_k^2 e_k^2 J_k' J_k.

Tensile curves with the standardised residuals z add dz/dx' dz/dx to A. With the inverse variance P of the priors, the
covariance of the optimum is

    C = inv(A + P) (B + P) inv(A + P).

This form is needed because the weights of the states differ from the inverse variance of their noise (sandwich
covariance: Huber 1967, Proc. 5th Berkeley Symp. 1:221; White 1982, Econometrica 50:1). If all states are equally noisy,
A equals B and C is inv(A + P).
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
    """The K states of one experiment, linearised in n unknowns about an optimum.

    Parameters
    ----------
    residuals : ndarray, shape (K, G, m)
        Residuals in mm, in G groups (edges, or x and y) of m neighbouring points.
    slopes : ndarray, shape (n, K, G, m)
        Derivatives of the residuals in the unit coordinates (0 to 1) of the unknowns, in mm.
    used : ndarray, shape (K, G, m)
        Above zero for points that are used, else zero (``Misfit.weights``).
    weights : ndarray, shape (K,)
        Weight w_k in 1/mm^2 of the squared residuals of each state in the likelihood.
    counts : ndarray, shape (K,)
        Number of points N_k of each state.
    error_mm : ndarray, shape (K,)
        Error e_k of each state in mm, the root mean square of its residuals.
    """

    residuals: Array
    slopes: Array
    used: Array
    weights: Array
    counts: Array
    error_mm: Array

    @property
    def information(self) -> Array:
        """The contribution of this experiment to the information A of the data, shape (n, n).

        It is the sum over the states k of w_k J_k' J_k, with the weights w_k and the derivatives J_k of the residuals
        in n unknowns.
        """
        return np.asarray(np.einsum("k,kij->ij", self.weights, self._by_state()))

    def score(self, residuals: Array) -> Array:
        """Return the contribution of residuals to the gradient of minus the log-likelihood in n unknowns, shape (n,).

        It is the sum over the states k of w_k J_k' r_k, with the weights w_k, the derivatives J_k and the residuals
        r_k. ``residuals`` has the shape (K, G, m), in mm, for G groups (edges, or x and y) of m points in K states.
        """
        return np.asarray(np.einsum("k,ikgn,kgn->i", self.weights, self.slopes, residuals))

    def score_variance(self, observed: Observation) -> Array:
        """Return the contribution of this experiment to the variance B of the score, shape (n, n).

        The score is the gradient of minus the log-likelihood in n unknowns. In the likelihood, the squared residuals of
        state k have the weight w_k. e_k is the root mean square of these residuals, J_k are their derivatives in the
        unknowns, and tau neighbouring points count as one independent point. For edges,

            B = sum_k tau w_k^2 e_k^2 J_k' J_k.

        For tracked points, all points of a state are assumed to have the same error: one in x and one in y. Such an
        error shifts all points together, and the residuals change by S_k, the sum of the slopes over the points.
        Therefore

            B = sum_k w_k^2 v_k S_k' S_k.

        The variance v_k of the common error is the mean square of the stated uncertainties, or e_k^2 / 2 if this is
        larger.
        """
        if isinstance(observed, EdgeObservation):
            tau = point_correlation(self.residuals, self.used, observed)
            return np.asarray(np.einsum("k,kij->ij", tau * (self.weights * self.error_mm) ** 2, self._by_state()))
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
    """The evidence of a fit (edges, tensile curves, priors), linearised about an optimum of n unknowns.

    Noise is the part of the residuals that no error of an uncertain input explains (`inference.interval.noise`).

    Parameters
    ----------
    unit : ndarray, shape (n,)
        The optimum in unit coordinates, from 0 to 1 within the bounds of the search.
    objective_mm : float
        The objective at the optimum in mm, without the priors on the law's parameters.
    states : tuple of LinearStates
        The linearised states of each experiment.
    points : int
        Number of measured points of all experiments.
    independent_points : float
        Number of independent points, estimated from all residuals.
    likelihood_points : float
        Number N of independent points from which the weights of the states in the likelihood are computed.
    noise_points : float
        Number of independent points, estimated from the noise alone.
    noise_mm : float
        Root mean square of the noise in a state in mm, as the mean over the states.
    residual_mm : float
        Root mean square of all residuals, in mm.
    curves : ndarray, shape (m,)
        Standardised residuals of the m rows of the tensile curves.
    curve_slopes : ndarray, shape (n, m)
        Derivatives of ``curves`` in the n unknowns.
    priors : ndarray, shape (f,)
        Deviations of the f freed nuisances (inputs that the fit determines), divided by their prior standard
        deviations.
    law_priors : ndarray, shape (q,)
        Standardised residuals of the q priors on the law's parameters.
    law_prior_slopes : ndarray, shape (n, q)
        Derivatives of ``law_priors`` in the n unknowns.
    information, score_variance, prior : ndarray, shape (n, n)
        The information A of the data (second derivatives of minus the log-likelihood), the variance B of the score
        (gradient of minus the log-likelihood), and the inverse variance P of the priors. ``prior`` does not contain the
        priors on the law's parameters.
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
    law_priors: Array
    law_prior_slopes: Array
    information: Array
    score_variance: Array
    prior: Array

    @property
    def law_prior_information(self) -> Array:
        """The information of the priors on the law's parameters: the Hessian of minus their logarithm, shape (n, n)."""
        return np.asarray(self.law_prior_slopes @ self.law_prior_slopes.T)

    @property
    def hessian(self) -> Array:
        """The Hessian of minus the sum of log-likelihood and all log-priors in n unknowns, shape (n, n)."""
        return self.information + self.prior + self.law_prior_information

    @property
    def score(self) -> Array:
        """The gradient of minus the sum of log-likelihood and all log-priors in n unknowns, shape (n,).

        It is zero at an optimum inside the bounds.
        """
        total = self.curve_slopes @ self.curves + self.law_prior_slopes @ self.law_priors
        for states in self.states:
            total = total + states.score(states.residuals)
        return self._with_priors(np.asarray(total)[None], self.priors[None])[0]

    def score_of(self, candidates: Evaluation) -> Array:
        """Return the gradient of minus the log-likelihood (the score) at each of P candidates near the optimum, (P, n).

        A candidate is one set of values of the n unknowns. The gradient is a sum of residuals times their derivatives
        (slopes) times the weights of the states. The residuals are those of the candidate, and the slopes those of the
        optimum, so that no further simulation is needed. The weight of a state is proportional to 1 / e, with its root
        mean square residual e for the candidate. The priors of freed inputs (inputs that the fit determines) are
        included, the priors on the law's parameters are not.
        """
        total = candidates.curves @ self.curve_slopes.T
        for states, misfit in zip(self.states, candidates.comparison.misfits, strict=True):
            optimum_error = np.sqrt((states.residuals**2).sum(axis=(1, 2)) / np.maximum(states.counts, 1e-12))
            weight = states.weights * optimum_error / np.maximum(misfit.error_mm, 1e-12)
            total = total + np.einsum("pk,ikgn,pkgn->pi", weight, states.slopes, misfit.residuals)
        return self._with_priors(total, candidates.priors)

    def _with_priors(self, score: Array, priors: Array) -> Array:
        searched = len(self.unit) - len(self.priors)
        score[:, searched:] += priors * np.sqrt(np.diag(self.prior)[searched:])
        return score

    def prior_distances(self) -> tuple[float, ...]:
        """Return how far each prior on a parameter of the law is from the other evidence, in standard deviations.

        The other evidence is the edges, the tensile curves and the other priors.

        Returns
        -------
        tuple of float
            One distance for each prior, positive if the parameter is above the mean of the prior.

        Notes
        -----
        The distance is the difference between the prior and the parameter that the other evidence gives, divided by the
        standard deviation of this difference. No second fit is needed: let z be the standardised residual of the prior
        at the optimum, s its derivative in the unknowns, and H the Hessian without this prior. Without the prior, the
        residual at the optimum would be z (1 + s' inv(H) s). Its variance is 1 (from the prior) plus s' inv(H) s (from
        the other evidence). The quotient of the residual and its standard deviation is z sqrt(1 + s' inv(H) s).
        """
        distances = []
        for z, slope in zip(self.law_priors, self.law_prior_slopes.T, strict=True):
            others = self.hessian - np.outer(slope, slope)
            distances.append(float(z * np.sqrt(1 + slope @ np.linalg.solve(others, slope))))
        return tuple(distances)

    def covariance(self, widened: float = 1.0) -> Array:
        """Return the covariance of the n unknowns, (n, n), if the noise is ``widened`` times its estimate."""
        inverse = np.linalg.inv(self.hessian)
        return np.asarray(
            inverse @ (widened**2 * self.score_variance + self.prior + self.law_prior_information) @ inverse
        )


def point_correlation(residuals: Array, weights: Array, observed: Observation) -> float:
    """Return how many neighbouring residuals count as one independent residual: the number tau.

    Errors of lens, light and law are similar along an edge and in neighbouring states. For edges, tau is therefore the
    product of two correlation lengths: in points along the edge, and in neighbouring states
    (`eimi_fitting.correlation`). For tracked points, one error is assumed common to all points of a state, so that each
    state has two independent numbers, x and y.

    Parameters
    ----------
    residuals : ndarray, shape (K, G, m)
        Residuals of K states in mm, in G groups (edges, or x and y) of m neighbouring points.
    weights : ndarray, shape (K, G, m)
        Zero for points that are not used.
    observed : EdgeObservation or PointObservation
        The measured edges or tracked points. tau is computed differently for edges and for tracked points.

    Returns
    -------
    float
        tau, at least 1.
    """
    if isinstance(observed, EdgeObservation):
        by_state = correlation_length(residuals.transpose(1, 2, 0), weights.transpose(1, 2, 0))
        return correlation_length(residuals, weights) * by_state
    return max(float(weights.sum()) / (2 * len(weights)), 1.0)


def independent_points(problem: Problem, misfits: tuple[Misfit, ...]) -> float:
    """Return how many of the measured points of all experiments count as independent.

    Neighbouring points have similar errors, so that several of them count as one. The number is computed from the
    residuals of the first candidate (set of values of the unknowns) in ``misfits``, which has one element for each
    experiment.
    """
    return sum(
        float(m.weights.sum()) / point_correlation(m.residuals[0], m.weights, e.observed)
        for m, e in zip(misfits, problem.experiments, strict=True)
    )


def linearise(problem: Problem, optimum: Optimum[Evaluation], likelihood_points: float | None = None) -> Linearisation:
    """Linearise the evidence of a fit (edges, tensile curves, priors) about its optimum, by central differences.

    Parameters
    ----------
    problem : Problem
        The law, the unknowns and the measurements of the fit.
    optimum : Optimum
        The optimum of the problem, with the evaluations for the differences.
    likelihood_points : float, optional
        Number N of independent points in the likelihood; estimated from the residuals by default.

    Returns
    -------
    Linearisation
        The linearised residuals, with the slopes of tensile curves and priors.
    """
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
    """Return the contribution of the tensile curves to the variance of the score in n unknowns, shape (n, n).

    The score is the gradient of minus the log-likelihood. Its variance follows from the noise of each curve. The noise
    is computed from the residuals of the joint fit, but is at least the noise of a fit to the curve alone. ``z`` has
    the standardised residuals of the joint fit, and ``slopes`` their derivatives in the unknowns.
    """
    variance = np.zeros((len(slopes), len(slopes)))
    first = 0
    for curve in problem.curves:
        rows = slice(first, first + len(curve.curve.strain))
        first = rows.stop
        # The expected sum of z^2 over m rows is m / tau.
        square = float((z[rows] ** 2).sum()) * curve.correlation_rows / len(curve.curve.strain)
        variance += max(curve.curve.weight, square) * slopes[:, rows] @ slopes[:, rows].T
    return variance
