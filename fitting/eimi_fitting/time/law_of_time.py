"""The fit of the viscoelastic (Prony) law of a material to all data together."""

# A least-squares fit starts at the result of a search by CMA-ES. With the residuals r(x) of the unknowns x, and the
# prior means and standard deviations, it minimises
#
#     chi² = |r(x)|² + sum ((x - mean) / sigma)².
#
# Laplace's approximation of the marginal likelihood Z (MacKay 2003, Information Theory, chapter 27) is
#
#     ln Z = -chi²/2 + ln det(posterior covariance)/2 - ln det(prior covariance)/2.
#
# The chosen number of terms is the smallest number whose ln Z is within 1 of the largest.

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.inference.evidence.experiment import DISCARDED_MM
from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_fitting.inference.searching.search import search
from eimi_fitting.time.evidence import Evidence
from eimi_fitting.time.terms import Terms

Array = NDArray[np.float64]

_SEARCHED = 2.0  # half-width of the searched range, in prior standard deviations
_MODULUS_RANGE = np.log(2.0)
_GENERATIONS = 20
# The search ends if the values of chi in a generation differ by less than this number times the square root of the
# number of unknowns.
_ENOUGH = 0.02
_POLISH_STEPS = 100
_POLISHED_STARTS = 3
_ADDED_SHARE = float(np.log(0.05))  # ln h of the term that is added to an optimum with fewer terms
_STEP = 1e-4  # step of the finite differences, in units of the unknowns
_FAILED = 1e3  # residual of a candidate without an equilibrium
_NEAR_EVIDENCE = 1.0  # the fewest terms are taken whose ln Z is within this of the largest
FREE_LOAD = 0.3
"""Prior standard deviation of the logarithm of the factor on magnetic loads, if no file gives an uncertainty of the
moment.
"""
EXACT_LOAD = 1e-4
"""Smallest prior standard deviation of the logarithm of the factor on the magnetic loads."""
_OF_MOMENT = ("moment", "remanence")
LOAD_SOURCES = (*_OF_MOMENT, "coil")
"""Keys of the sources of uncertainty that act as a factor on all magnetic loads."""


def relative_load_sigmas(stated: Sequence[StatedSource], specimen: Specimen) -> dict[str, float] | None:
    """Return the relative uncertainties of the magnetic loads, by the inputs that cause them."""
    # None without a magnet, or without an uncertainty of its moment.
    magnet = specimen.magnet
    if magnet is None or not any(source.source in _OF_MOMENT for source in stated):
        return None
    sigmas = {source.source: source.standard_uncertainty for source in stated if source.source in LOAD_SOURCES}
    if "remanence" in sigmas:
        sigmas["remanence"] /= abs(magnet.remanence_T)
    return {key: sigma for key, sigma in sigmas.items() if sigma}


@dataclass(frozen=True)
class Problem:
    """The least-squares problem of a viscoelastic law: unknowns, priors and data."""

    # The last of the m unknowns is ln(factor on the magnetic loads). P candidate laws are computed at once.

    # The unknowns of the law, with their priors.
    terms: Terms
    # The data.
    evidence: tuple[Evidence, ...]
    # Prior standard deviation of ln(factor on the magnetic loads).
    load_sigma: float

    @property
    def mean(self) -> Array:
        """The prior means of the unknowns."""
        return np.append(self.terms.mean, 0.0)

    @property
    def sigma(self) -> Array:
        """The prior standard deviations of the unknowns."""
        return np.append(self.terms.sigma, self.load_sigma)

    def rows(self, unknowns: Array) -> Array:
        """Return the residuals of the data for many candidate laws, one row each."""
        # ``unknowns`` (P, m) gives (P, k) for k residuals.
        instantaneous, series = self.terms.split(unknowns[:, :-1])
        with np.errstate(all="ignore"):
            rows = [one.residuals(instantaneous, series, unknowns[:, -1]) for one in self.evidence]
        return np.concatenate(rows, axis=1)

    def residuals(self, unknowns: Array) -> Array:
        """Return the residuals of the data and of the priors for many candidate laws, one row each."""
        return np.concatenate([self.rows(unknowns), (unknowns - self.mean) / self.sigma], axis=1)

    def effects(self, sources: Mapping[str, float]) -> dict[str, Array]:
        """Return the change of each residual if an uncertain input, such as the width, changes by its uncertainty."""
        parts = [one.effects(sources) for one in self.evidence]
        return {key: np.concatenate([part[key] for part in parts], axis=1) for key in sources}

    def chi(self, unknowns: Array) -> Array:
        """Return the square root of the sum of the squared residuals for each candidate law."""
        residuals = self.residuals(unknowns)
        total = np.sqrt((residuals**2).sum(axis=1))
        return np.where(np.isfinite(total), total, np.inf)


@dataclass(frozen=True)
class _Values:
    """The objective function of many candidate laws, in the form that `search` needs."""

    objective_mm: Array
    unconverged: NDArray[np.bool_]
    unstable: NDArray[np.bool_]


@dataclass(frozen=True)
class TimeOptimum:
    """The optimum of the fit of a viscoelastic law."""

    # The least-squares problem.
    problem: Problem
    # (m,): the unknowns at the optimum.
    unknowns: Array
    # (k + m, m): derivatives of k residuals of the data and m of the priors.
    jacobian: Array
    # Sum of the squared residuals of the data.
    chi2: float
    # Logarithm of the marginal likelihood.
    log_evidence: float
    # Number of laws that were computed.
    evaluations: int
    # Whether the least-squares fit converged.
    converged: bool

    @property
    def covariance(self) -> Array:
        """The posterior covariance of the unknowns due to noise and priors."""
        return np.asarray(np.linalg.inv(self.jacobian.T @ self.jacobian))

    def steps(self, effects: Mapping[str, Array]) -> dict[str, Array]:
        """Return the change of the fitted unknowns by each uncertain input."""
        # ``effects``: the change of each residual by each input, (components of the input, k). The result is
        # (components, m).
        gain = -self.covariance @ self.jacobian[: len(self.jacobian) - len(self.unknowns)].T
        return {key: rows @ gain.T for key, rows in effects.items()}

    def load_step(self, sigma: float) -> Array:
        """Return the change of the fitted unknowns by a relative error ``sigma`` of the magnetic loads."""
        # The error shifts the prior mean of ln(factor on the magnetic loads), the last unknown.
        return np.asarray(self.covariance @ self.jacobian.T[:, -1] * sigma / self.problem.load_sigma)

    def with_free_load(self) -> TimeOptimum:
        """Repeat the fit with almost no prior knowledge of the magnetic moment."""
        problem = replace(self.problem, load_sigma=FREE_LOAD)
        unknowns, jacobian, evaluations, converged = _polished(problem, self.unknowns)
        chi2 = float((problem.rows(unknowns[None]) ** 2).sum())
        return TimeOptimum(
            problem, unknowns, jacobian, chi2, self.log_evidence, self.evaluations + evaluations, converged
        )


def optimum_of(problem: Problem, seed: int = 1, with_fewer_terms: TimeOptimum | None = None) -> TimeOptimum:
    """Fit a viscoelastic law by least squares from several starting points, and return the best optimum."""
    # ``with_fewer_terms``: the optimum with one term fewer in the Prony series, which gives further starting points.
    starts, evaluations = [problem.mean], 0
    # Some of the fits start from the optimum with one term fewer.
    if with_fewer_terms is not None:
        n = problem.terms.count
        for time in problem.terms.mean[1 + n :]:
            before = with_fewer_terms.unknowns
            h, tau = np.append(before[1:n], _ADDED_SHARE), np.append(before[n : 2 * n - 1], time)
            order = np.argsort(tau)
            starts.append(np.concatenate([before[:1], h[order], tau[order], before[-1:]]))
    reach = np.minimum(_SEARCHED * problem.sigma, np.append(np.full(len(problem.mean) - 1, np.inf), 0.3))
    reach[0] = _MODULUS_RANGE
    low = problem.mean - reach

    def objective(units: Array) -> _Values:
        chi = problem.chi(low + 2 * reach * units)
        failed = ~np.isfinite(chi)
        # Here the objective has no unit.
        return _Values(np.where(failed, DISCARDED_MM, chi), failed, np.zeros(len(chi), bool))

    result = search(
        objective, len(low), seed=seed, most_generations=_GENERATIONS, enough_mm=_ENOUGH * np.sqrt(len(low))
    )
    starts.append(low + 2 * reach * result.unit)
    evaluations = result.evaluations
    best = np.argsort(problem.chi(np.array(starts)))[:_POLISHED_STARTS]
    polished = [_polished(problem, starts[int(k)]) for k in best]
    unknowns, jacobian, spent, converged = min(polished, key=lambda one: float(problem.chi(one[0][None])[0]))
    evaluations += sum(one[2] for one in polished) - spent
    posterior = jacobian.T @ jacobian
    chi2_all = float((problem.residuals(unknowns[None]) ** 2).sum())
    log_evidence = -0.5 * (chi2_all + float(np.linalg.slogdet(posterior)[1])) - float(np.log(problem.sigma).sum())
    chi2 = float((problem.rows(unknowns[None]) ** 2).sum())
    return TimeOptimum(problem, unknowns, jacobian, chi2, log_evidence, evaluations + spent, converged)


def _polished(problem: Problem, start: Array) -> tuple[Array, Array, int, bool]:
    """Fit the unknowns by least squares, from one starting point."""
    # The result: unknowns, Jacobian, number of computed candidate laws, and whether the fit converged.
    m, scale = len(start), np.minimum(problem.sigma, 1.0)
    moves = _STEP * np.concatenate([np.zeros((1, m)), np.diag(scale), -np.diag(scale)])
    last: tuple[Array, Array] = (np.full(m, np.nan), np.zeros((0, m)))

    def residuals(unknowns: Array) -> Array:
        # The neighbours for the Jacobian are computed at once: they cost hardly more than one candidate alone.
        nonlocal last
        rows = problem.residuals(unknowns + moves)
        slopes = (rows[1 : m + 1] - rows[m + 1 :]) / (2 * _STEP * scale[:, None])
        last = unknowns.copy(), np.ascontiguousarray(np.where(np.isfinite(slopes), slopes, 0.0).T)
        return np.where(np.isfinite(rows[0]), rows[0], _FAILED)

    def jacobian(unknowns: Array) -> Array:
        if not np.array_equal(unknowns, last[0]):
            residuals(unknowns)
        return last[1]

    solved = scipy.optimize.least_squares(
        residuals, start, jac=jacobian, method="lm", x_scale=scale, max_nfev=_POLISH_STEPS, ftol=1e-6, xtol=1e-6
    )
    spent = int(solved.nfev) * (1 + 2 * m)
    return np.asarray(solved.x), jacobian(solved.x), spent, bool(solved.status > 0)


def best_number_of_terms(problems: Sequence[Problem], seed: int = 1) -> tuple[TimeOptimum, tuple[TimeOptimum, ...]]:
    """Choose the number of terms of the Prony series; return the chosen optimum and all optima."""
    # The problems have an increasing number of terms.
    optima: list[TimeOptimum] = []
    for problem in problems:
        optima.append(optimum_of(problem, seed, optima[-1] if optima else None))
        if len(optima) > 1 and optima[-1].log_evidence < optima[-2].log_evidence + _NEAR_EVIDENCE:
            break
    largest = max(one.log_evidence for one in optima)
    return next(one for one in optima if one.log_evidence > largest - _NEAR_EVIDENCE), tuple(optima)


_FEATURE_TIMES_S = np.geomspace(1e-3, 1e4, 29)
_WALKERS, _MOVES, _THINNED = 96, 480, 60
_STRETCH = 2.0


def _features(terms: Terms, unknowns: Array, omegas: Array) -> Array:
    # The residuals depend almost linearly on these features. ``unknowns`` (P, m) gives (P, f) for f features, such as
    # ln(modulus) at ``omegas`` (rad/s).
    instantaneous, series = terms.split(unknowns[:, :-1])
    ratio = series.complex_ratio(np.broadcast_to(1j * omegas, (len(unknowns), len(omegas))))
    moduli = instantaneous[:, None] * series.ratio(_FEATURE_TIMES_S)
    return np.concatenate(
        [
            np.log(instantaneous[:, None] * ratio.real),
            ratio.imag / ratio.real,
            np.log(moduli),
            unknowns[:, -1:],
        ],
        axis=1,
    )


def drawn(optimum: TimeOptimum, steps: Mapping[str, Array], seed: int, omegas: Array, of_sources: bool = True) -> Array:
    """Draw random values of the unknowns from their posterior distribution."""
    # ``steps``: the change of the unknowns by each uncertain input. ``omegas``: angular frequencies of the data in
    # rad/s. ``of_sources``: whether the draws contain the errors of the inputs. The result is (draws, m).
    problem, at = optimum.problem, optimum.unknowns
    rng = np.random.default_rng(seed)
    m = len(at)
    rows_at = problem.rows(at[None])[0]
    features_at = _features(problem.terms, at[None], omegas)[0]
    moved = at + _STEP * np.concatenate([np.eye(m), -np.eye(m)])
    ends = _features(problem.terms, moved, omegas)
    slopes = ((ends[:m] - ends[m:]) / (2 * _STEP)).T
    # The residuals are approximated by a linear function of the features, which makes the draws fast.
    rows_by_features = optimum.jacobian[: len(rows_at)] @ np.linalg.pinv(slopes, rcond=1e-6)

    def log_density(x: Array) -> Array:
        rows = rows_at + (_features(problem.terms, x, omegas) - features_at) @ rows_by_features.T
        prior = (x - problem.mean) / problem.sigma
        return np.asarray(-0.5 * ((rows**2).sum(axis=1) + (prior**2).sum(axis=1)))

    values, vectors = np.linalg.eigh(optimum.covariance)
    walkers = at + 0.3 * rng.standard_normal((_WALKERS, m)) * np.sqrt(np.maximum(values, 0.0)) @ vectors.T
    density, half = log_density(walkers), _WALKERS // 2
    samples = []
    # A walker moves along the line through itself and another walker; the move is accepted or rejected by the density
    # at its end (Goodman and Weare 2010, Comm. App. Math. Comp. Sci. 5:65).
    for move in range(_MOVES):
        for first in (slice(0, half), slice(half, None)):
            others = walkers[half:] if first.start == 0 else walkers[:half]
            z = ((_STRETCH - 1) * rng.random(half) + 1) ** 2 / _STRETCH
            partner = others[rng.integers(half, size=half)]
            trial = partner + z[:, None] * (walkers[first] - partner)
            after = log_density(trial)
            taken = np.log(rng.random(half)) < (m - 1) * np.log(z) + after - density[first]
            walkers[first] = np.where(taken[:, None], trial, walkers[first])
            density[first] = np.where(taken, after, density[first])
        if move >= _MOVES // 3 and move % _THINNED == 0:
            samples.append(walkers.copy())
    draws = np.concatenate(samples)
    if of_sources:
        for moves in steps.values():
            draws = draws + rng.standard_normal((len(draws), len(moves))) @ moves
    return np.asarray(draws)
