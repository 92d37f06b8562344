"""What an identified parameter is worth: intervals, and which combinations the data fix.

Linearised about the optimum (`eimi_fitting.linearised`): the noise level from the residuals themselves, tau alike
points of edges counting as one; tracked points carry their own stated uncertainty, taken as common to the points of
one state. Where the objective is not the quadratic that this takes it for, the profile likelihood gives the ends
(`eimi_fitting.profile`). What the mesh leaves in the parameters is in the intervals (`eimi_fitting.mesh_error`).

A direction that the data do not fix is held by the bounds of the search, entered as a normal prior with the bounds'
variance; it is named as not fixed. Errors common to the whole experiment (coil constant, moment, roll, clamp) are in
the intervals where they are freed, and not otherwise; those of the scale never.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from eimi_fitting.directions import NOT_FIXED, Direction, directions, statement
from eimi_fitting.experiment import DISCARDED_MM
from eimi_fitting.linearised import Linearised, held_out_error_mm, linearise
from eimi_fitting.mesh_error import LEFT
from eimi_fitting.observation import EdgeObservation
from eimi_fitting.problem import Problem
from eimi_fitting.profile import Ends, interval_ends, moved_to

Array = NDArray[np.float64]

_DRAWS = 4000  # a quantile of 2.5 % of so many is good to 2 % of its distance from the middle
# A material is called compressible only where the objective has risen this many times as far as an interval's end asks,
# when it is taken as incompressible: an error of the mesh as large as the noise looks like some compressibility.
_PRETENDED = 10.0
_NORMAL = float(special.ndtri(0.975))


@dataclass(frozen=True)
class FreedValue:
    """A nuisance that was freed: its deviation from what was stated, with interval and prior standard deviation."""

    name: str
    dataset: int | None
    unit: str
    value: float
    interval: tuple[float, float]
    prior_spread: float


@dataclass(frozen=True)
class Uncertainty:
    """95 % intervals and what the data fix.

    intervals: (n_p, 2) of the law's parameters; initial_shear_modulus_Pa, bulk_modulus_Pa: (2,) or None;
    noise_mm: residual standard deviation;
    points, independent_points: how many there are and how many they count as; correlation_points: their mean ratio;
    names and correlation: of all unknowns; directions: best known first; not_fixed: coordinates of the law that only
    the bounds hold; profiled: those whose ends come from the profile likelihood; mesh_change, mesh_left: relative
    change of the initial shear modulus by the finer mesh, and the half-width left for it (None: the finer mesh found no
    solution); held_out_error_mm: mean error of states left out of the fit; statement: what is fixed, in words.
    """

    intervals: Array
    initial_shear_modulus_Pa: Array
    bulk_modulus_Pa: Array | None
    freed: tuple[FreedValue, ...]
    noise_mm: float
    points: int
    independent_points: float
    correlation_points: float
    names: tuple[str, ...]
    correlation: Array
    directions: tuple[Direction, ...]
    not_fixed: tuple[str, ...]
    profiled: tuple[str, ...]
    mesh_change: float | None
    mesh_left: float | None
    held_out_error_mm: float
    statement: str


def estimate_uncertainty(problem: Problem, unit: Array, seed: int, moved: Array | None) -> Uncertainty:
    """Intervals about the optimum ``unit`` (n,), of which the draws behind the intervals need a seed.

    moved: (n,) how far the finer mesh moved the optimum, None where it found no solution. Costs a batch of 2 n + 1
    candidates and the intervals' ends.
    """
    n, searched = len(unit), problem.searched
    about = linearise(problem, unit)
    covariance = about.covariance(_widened(problem, about))
    correlation = covariance / np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    left = np.zeros(n) if moved is None else LEFT * moved
    noise = np.sqrt(np.diag(covariance))
    # An error of the mesh moves the optimum along one direction, by no more than this. Higher coefficients can take it
    # upon themselves; the modulus is trusted no more than with them held.
    alone = np.sqrt(max((LEFT * _modulus_alone(problem, about)) ** 2 - left[0] ** 2, 0.0))
    remaining = noise * np.sqrt(np.diag(about.prior))
    eigen = directions(problem.names, about.information, about.prior)
    looked_at = remaining[:searched] <= NOT_FIXED
    if problem.space.has_bulk:  # without an end above, and far from linear toward its lower one
        looked_at[-1] = True
    ends = _ends(problem, about, _NORMAL * noise, tuple(int(i) for i in np.flatnonzero(looked_at)))
    if problem.space.has_bulk and ends.high[searched - 1] >= 1.0:
        remaining[searched - 1] = 1.0
    rng = np.random.default_rng(seed)
    draws = rng.multivariate_normal(np.zeros(n), covariance, size=_DRAWS, method="eigh")
    for i in ends.profiled:  # a normal distribution of two halves, each as wide as its end asks
        below, above = (unit[i] - ends.low[i]) / (_NORMAL * noise[i]), (ends.high[i] - unit[i]) / (_NORMAL * noise[i])
        draws[:, i] *= np.where(draws[:, i] < 0, below, above)
    draws += np.outer(rng.normal(size=_DRAWS), left) / _NORMAL
    draws[:, 0] += rng.normal(size=_DRAWS) * alone / _NORMAL
    drawn = np.clip(unit + draws, 0.0, 1.0)[:, :searched]
    parameters = problem.space.parameters(drawn)
    bulk = problem.space.bulk_modulus_Pa(drawn)
    not_fixed = tuple(name for name, r in zip(problem.space.names, remaining, strict=False) if r > NOT_FIXED)
    # of the modulus, whose logarithm the first coordinate is
    log_range = float(np.log(problem.space.upper[0] / problem.space.lower[0]))
    return Uncertainty(
        np.quantile(parameters, [0.025, 0.975], axis=0).T,
        np.quantile(problem.law.initial_shear_modulus(parameters), [0.025, 0.975]),
        None if bulk is None else np.quantile(bulk, [0.025, 0.975]),
        _freed(problem, unit, np.hypot(_NORMAL * noise, left)),
        about.noise_mm,
        about.points,
        about.independent_points,
        about.points / about.independent_points,
        problem.names,
        correlation,
        eigen,
        not_fixed,
        tuple(problem.names[i] for i in ends.profiled),
        None if moved is None else float(np.expm1(moved[0] * log_range)),
        None if moved is None else float(np.hypot(left[0], alone) * log_range),
        held_out_error_mm(about),
        statement(problem.names, searched, remaining, correlation, eigen),
    )


def _modulus_alone(problem: Problem, about: Linearised) -> float:
    """How far the finer mesh moves the modulus' coordinate with all others held."""
    pull = 0.0
    for d, experiment in enumerate(problem.experiments):
        if experiment.mesh_change is not None:
            pull += float(np.einsum("k,kgn,kgn->", about.weights[d], about.slopes[d][0], experiment.mesh_change))
    return -pull / float(about.curvature[0, 0])


def _widened(problem: Problem, about: Linearised) -> float:
    """Student's t over the normal quantile, where level and correlation of the noise are the residuals' own.

    As many residuals tell them as there are edges: one degree of freedom less than these (Bester, Conley and Hansen
    2011, J. Econometrics 165:137). Tracked points state theirs.
    """
    if not all(isinstance(e.observed, EdgeObservation) for e in problem.experiments):
        return 1.0
    edges = sum(residuals.shape[0] * residuals.shape[1] for residuals in about.residuals)
    freedom = max(min(about.independent_points - len(about.unit), edges - 1), 1.0)
    return float(special.stdtrit(freedom, 0.975)) / _NORMAL


def _ends(problem: Problem, about: Linearised, half_width: Array, looked_at: tuple[int, ...]) -> Ends:
    """Interval ends by the objective itself, where it is not the quadratic that the covariance takes it for."""
    searched = problem.searched
    m = len(about.curves)
    bounds_prior = np.where(np.arange(len(about.unit)) < searched, np.diag(about.prior), 0.0)

    def rise(unit: Array) -> tuple[Array, Array]:
        judged = problem.judge(unit, about.independent_points)
        objective = judged.objective_mm
        valid = objective < DISCARDED_MM
        moved = unit - about.unit
        # The sum of squares above its least in units of its variance: with a noise level that is unknown too, this is
        # what Student's t looks at (Seber and Wild 1989, section 5.3).
        ratio = np.where(valid, objective, np.inf) / about.objective_mm
        value = about.independent_points * (ratio**2 - 1) + (bounds_prior * moved**2).sum(axis=1)
        # Slopes frozen, weights of the candidate's own errors.
        gradient = judged.standardised[:, :m] @ about.curve_slopes.T
        gradient[:, searched:] += judged.standardised[:, m:] * np.sqrt(np.diag(about.prior)[searched:])
        for d, misfit in enumerate(judged.comparison.misfits):
            here = np.sqrt((about.residuals[d] ** 2).sum(axis=(1, 2)) / np.maximum(about.counts[d], 1e-12))
            weight = about.weights[d] * here / np.maximum(misfit.error_mm, 1e-12)
            gradient += np.einsum("pk,ikgn,pkgn->pi", weight, about.slopes[d], misfit.residuals)
        gradient = gradient * np.where(valid, ratio, 1.0)[:, None] + bounds_prior * moved
        return np.where(valid, value, np.inf), gradient

    ends = interval_ends(rise, about.unit, about.gradient, about.curvature, half_width, looked_at)
    bulk = searched - 1
    if problem.space.has_bulk and ends.high[bulk] < 1.0:
        point, gradient = about.unit, about.gradient
        least = np.inf
        for _ in range(2):
            point = moved_to(point, gradient, about.curvature, bulk, 1.0)
            values, gradients = rise(point[None])
            gradient, least = gradients[0], min(least, float(values[0]))
        target = half_width[bulk] ** 2 / np.linalg.inv(about.curvature)[bulk, bulk]
        if least < _PRETENDED * target:
            high = ends.high.copy()
            high[bulk] = 1.0
            return Ends(ends.low, high, tuple(sorted({*ends.profiled, bulk})))
    return ends


def _freed(problem: Problem, unit: Array, half_width: Array) -> tuple[FreedValue, ...]:
    found = []
    for i, nuisance in enumerate(problem.freed, problem.searched):
        value, low, high = nuisance.value(unit[i] + half_width[i] * np.array([0.0, -1.0, 1.0]))
        found.append(
            FreedValue(
                nuisance.name,
                nuisance.dataset,
                nuisance.unit,
                float(value),
                (float(low), float(high)),
                nuisance.spread,
            )
        )
    return tuple(found)
