"""Compute the 95 % intervals of the unknowns of a fit.

The intervals contain the noise, the error of the beam model, and the uncertainties of specimen, calibration and rig.
"""

# The bounds of the search count as a normal prior, with the variance of a uniform distribution between the bounds.

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from eimi_fitting.inference.evidence.corrections import FINER_MESH, SOLID
from eimi_fitting.inference.evidence.experiment import DISCARDED_MM
from eimi_fitting.inference.evidence.measurements import EdgeObservation
from eimi_fitting.inference.evidence.objective import Evaluation, Problem
from eimi_fitting.inference.evidence.quantity import NORMAL_95, Quantity
from eimi_fitting.inference.evidence.unknowns import Unknowns
from eimi_fitting.inference.interval.budget import BudgetEntry, MeasureNext, Moves, budget, budget_entries
from eimi_fitting.inference.interval.considered import ConsideredInput, considered, steps_of, unstated_of
from eimi_fitting.inference.interval.covariance import Linearisation
from eimi_fitting.inference.interval.cross_validation import held_out_error_mm
from eimi_fitting.inference.interval.draws import Draws, draw_noise, normal_draws, quantity, rounded, thinned
from eimi_fitting.inference.interval.identifiability import (
    NOT_FIXED,
    Identifiability,
    directions,
    held_by_bounds,
    is_open,
    statement,
)
from eimi_fitting.inference.interval.noise import Effect, Explained, Noise
from eimi_fitting.inference.interval.profile_likelihood import Ends, interval_ends, moved_to
from eimi_fitting.inference.searching.polish import Optimum
from eimi_fitting.laws.law import Law

Array = NDArray[np.float64]

# A mesh error as large as the noise looks like some compressibility. The upper end of the bulk modulus is therefore
# closed only if the deviance of the incompressible material exceeds this many times the deviance at an interval's end.
# Measured on four virtual specimens of an incompressible material: 5.3, 3.1, 0.8 and 0.7 times.
_APPARENT_COMPRESSIBILITY = 10.0
_BULK = "bulk_modulus"
_AT_BOUND = 1e-3  # distance from a bound, as a share of the coordinate's range
_SLOPE_STEP = 1e-4  # step of a finite difference, as a share of the coordinate's range


@dataclass(frozen=True)
class FreedNuisance:
    """The fitted error of an uncertain input, such as the width, that was fitted with the law."""

    # Name of the input in a result.
    name: str
    # Indices of the datasets with this error.
    datasets: tuple[int, ...]
    # Fitted value minus specified value.
    deviation: Quantity
    # In the unit of the deviation.
    prior_standard_deviation: float


@dataclass(frozen=True)
class CorrectionEffect:
    """The change of the initial shear modulus by an accurate beam model, such as one with a finer mesh."""

    # Change of the modulus in per cent.
    change_percent: float | None
    # 95 % bound of the error of the modulus with the accurate model, in per cent.
    left_percent: float | None


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """The parameters of a fitted hyperelastic law, with 95 % intervals.

    Parameters
    ----------
    parameters : dict of str to Quantity
        The parameters of the law by name.
    initial_shear_modulus : Quantity
        The initial shear modulus in Pa.
    bulk_modulus : Quantity or None
        The bulk modulus in Pa; None unless it was fitted.
    freed : tuple of FreedNuisance
        The uncertain inputs, such as the width, that were fitted with the law.
    identifiability : Identifiability
        Which unknowns the data determine.
    mesh : CorrectionEffect or None
        Change of the modulus by a finer mesh.
    section_change : CorrectionEffect or None
        Change of the modulus by a three-dimensional model.
    held_out_error_mm : float or None
        Mean error in mm of load cases that were omitted from the fit (cross-validation).
    budget : tuple of BudgetEntry
        Effect of each uncertain input on the initial shear modulus, the largest first.
    measure_next : MeasureNext
        The quantity whose better measurement narrows the interval of the modulus most.
    if_uncertain : tuple of BudgetEntry
        Effect of important inputs for which no file gives an uncertainty.
    draws : Draws or None
        Random draws, from which the intervals are computed.
    """

    parameters: dict[str, Quantity]
    initial_shear_modulus: Quantity
    bulk_modulus: Quantity | None
    freed: tuple[FreedNuisance, ...]
    identifiability: Identifiability
    mesh: CorrectionEffect | None
    section_change: CorrectionEffect | None = None
    held_out_error_mm: float | None
    budget: tuple[BudgetEntry, ...]
    measure_next: MeasureNext
    if_uncertain: tuple[BudgetEntry, ...] = ()
    draws: Draws | None = None


def estimate(
    problem: Problem,
    optimum: Optimum[Evaluation],
    effects: Sequence[Effect],
    noise: Noise,
    refinements: Sequence[str],
    seed: int,
    shift_percent: float = 0.0,
) -> Estimate:
    """Return the parameters of a fitted law with their 95 % intervals."""
    # effects: changes of the fitted values by accurate beam models. refinements: names of the accurate models that were
    # tried. shift_percent: 95 % bound of a further error of the modulus, which widens the interval.
    unknowns, unit = problem.unknowns, optimum.unit
    about, explained, sources = noise.about, noise.explained, noise.sources
    covariance = about.covariance(_widened(problem, about))
    spread = np.sqrt(np.diag(covariance))
    model_errors, modulus_errors = _model_error_bounds(unknowns, about, effects)
    # The intervals of the checked unknowns may be asymmetric.
    checked = (spread * np.sqrt(unknowns.prior))[: unknowns.searched] <= NOT_FIXED
    if unknowns.space.has_bulk:  # its upper end may be infinite, and toward the lower end the response is not linear
        checked[-1] = True
    ends = _ends(problem, about, optimum, NORMAL_95 * spread, tuple(int(i) for i in np.flatnonzero(checked)))
    steps = steps_of(about, sources, covariance)
    everything = covariance + steps.sizes.T @ steps.sizes
    remaining = np.minimum(np.sqrt(np.diag(everything) * unknowns.prior), 1.0)
    if unknowns.space.has_bulk and ends.high[unknowns.searched - 1] >= 1.0:
        remaining[unknowns.searched - 1] = 1.0
    rng = np.random.default_rng(seed)
    moved = draw_noise(rng, unit, covariance, ends, model_errors / NORMAL_95, modulus_errors / NORMAL_95)
    moves = Moves(unit, moved, normal_draws(rng, len(sources)), steps)
    if shift_percent:
        shift = np.log1p(1e-2 * shift_percent) / (NORMAL_95 * _log_range(unknowns))
        moves = replace(moves, further=shift * normal_draws(rng, 1) * (np.arange(len(unit)) == 0))
    entries, measure_next = budget(sources, moves, lambda units: _modulus(problem.law, unknowns, units))
    quantities = _quantities(problem.law, unknowns, moves, sources, seed)
    modulus = quantities["initial_shear_modulus"]
    percent = _effects_percent(unknowns, effects, refinements, model_errors, modulus_errors)
    identifiability = _identifiability(problem, about, explained, everything, remaining, ends, modulus)
    return Estimate(
        **quantities,
        identifiability=replace(identifiability, model_mm=noise.mean_model_mm),
        mesh=percent.get(FINER_MESH.name),
        section_change=percent.get(SOLID.name),
        held_out_error_mm=held_out_error_mm(explained.states, explained.hessian),
        budget=entries,
        measure_next=measure_next,
        if_uncertain=_if_uncertain(problem, about, covariance),
    )


def _if_uncertain(problem: Problem, about: Linearisation, covariance: Array) -> tuple[BudgetEntry, ...]:
    # The effect on the modulus of inputs for which no file gives an uncertainty, if they had a usual one.
    sources = considered(problem, about.unit, unstated_of(problem))
    sizes = steps_of(about, sources, covariance).sizes
    return budget_entries(sources, about.unit, sizes, lambda units: _modulus(problem.law, problem.unknowns, units))


def _model_error_bounds(unknowns: Unknowns, about: Linearisation, effects: Sequence[Effect]) -> tuple[Array, Array]:
    # 95 % bounds of the errors that remain after each of C corrections by accurate beam models: of the n unknowns, (C,
    # n), and of the modulus, (C,).
    model_errors, modulus_errors = np.zeros((len(effects), len(about.unit))), np.zeros(len(effects))
    log_range = _log_range(unknowns)
    for c, effect in enumerate(effects):
        share = effect.remaining_share
        score = sum(
            states.score(change)[0] for states, change in zip(about.states, effect.correction.changes, strict=True)
        )
        model_errors[c] = share * effect.moved
        # Other unknowns may compensate for a part of an error. Both bounds of the modulus together are therefore at
        # least as large as its bound with all other unknowns fixed.
        whole = max(abs(share * score / about.hessian[0, 0]), np.log1p(1e-2 * effect.least_percent) / log_range)
        modulus_errors[c] = np.sqrt(max(whole**2 - model_errors[c, 0] ** 2, 0.0))
    return model_errors, modulus_errors


def _log_range(unknowns: Unknowns) -> float:
    # ln(upper bound / lower bound) of the modulus in the search.
    return float(np.log(unknowns.space.upper[0] / unknowns.space.lower[0]))


def _effects_percent(
    unknowns: Unknowns,
    effects: Sequence[Effect],
    refinements: Sequence[str],
    model_errors: Array,
    modulus_errors: Array,
) -> dict[str, CorrectionEffect]:
    log_range = _log_range(unknowns)
    # None if the solver finds no equilibrium with the accurate model
    percent = dict.fromkeys(refinements, CorrectionEffect(None, None))
    for effect, bounds, modulus_bound in zip(effects, model_errors, modulus_errors, strict=True):
        percent[effect.correction.refinement.name] = CorrectionEffect(
            change_percent=100 * float(np.expm1(effect.moved[0] * log_range)),
            left_percent=100 * float(np.hypot(bounds[0], modulus_bound) * log_range),
        )
    return percent


def _widened(problem: Problem, about: Linearisation) -> float:
    # The factor by which the intervals are wider because the size of the noise is estimated (Student's t).
    if not all(isinstance(e.observed, EdgeObservation) for e in problem.experiments):
        # the noise of tracked points is stated
        return 1.0
    edges = sum(states.residuals.shape[0] * states.residuals.shape[1] for states in about.states)
    # The errors along one edge are correlated, so that E edges give at most E - 1 degrees of freedom (Bester, Conley
    # and Hansen 2011, J. Econometrics 165:137).
    freedom = max(min(about.noise_points - len(about.unit), edges - 1), 1.0)
    return float(scipy.special.stdtrit(freedom, 0.975)) / NORMAL_95


def _ends(
    problem: Problem,
    about: Linearisation,
    optimum: Optimum[Evaluation],
    half_width: Array,
    checked: tuple[int, ...],
) -> Ends:
    searched, law_prior_squares = problem.unknowns.searched, float((about.law_priors**2).sum())
    bounds_prior = np.where(np.arange(len(about.unit)) < searched, np.diag(about.prior), 0.0)

    def deviance(unit: Array) -> tuple[Array, Array]:
        candidates = problem.evaluate(unit, about.likelihood_points, near=optimum.evaluation.comparison.near)
        objective = candidates.without_law_priors.objective_mm
        valid = objective < DISCARDED_MM
        moved = unit - about.unit
        # The rise of the sum of squares in units of the noise variance has the distribution of t^2 with Student's t if
        # the noise level is estimated (Seber and Wild 1989, Nonlinear Regression, section 5.3).
        ratio = np.where(valid, objective, np.inf) / about.objective_mm
        # The standard deviation of a prior is stated, so that its part of the deviance is its sum of squares.
        prior_part = (bounds_prior * moved**2).sum(axis=1) + (candidates.law_priors**2).sum(axis=1) - law_prior_squares
        value = about.likelihood_points * (ratio**2 - 1) + prior_part
        score = about.score_of(candidates) * np.where(valid, ratio, 1.0)[:, None]
        score += bounds_prior * moved + candidates.law_priors @ about.law_prior_slopes.T
        return np.where(valid, value, np.inf), score

    ends = interval_ends(deviance, about.unit, about.score, about.hessian, half_width, checked)
    bulk = searched - 1
    if problem.unknowns.space.has_bulk and ends.high[bulk] < 1.0:
        point, score = about.unit, about.score
        least = np.inf
        for _ in range(2):
            point = moved_to(point, score, about.hessian, bulk, 1.0)
            values, scores = deviance(point[None])
            score, least = scores[0], min(least, float(values[0]))
        target = half_width[bulk] ** 2 / np.linalg.inv(about.hessian)[bulk, bulk]
        if least < _APPARENT_COMPRESSIBILITY * target:
            high = ends.high.copy()
            high[bulk] = 1.0
            return Ends(ends.low, high, tuple(sorted({*ends.profiled, bulk})))
    return ends


def _modulus(law: Law, unknowns: Unknowns, units: Array) -> Array:
    return law.initial_shear_modulus(unknowns.parameters(units))


def _quantities(
    law: Law, unknowns: Unknowns, moves: Moves, sources: Sequence[ConsideredInput], seed: int
) -> dict[str, Any]:
    # The result contains attributes of an `Estimate`.
    drawn_units = moves.units(), moves.units(of_sources=0.0)
    kept = [thinned(_modulus(law, unknowns, units)) for units in drawn_units]
    all_sources, fit_alone = (units[rows] for units, rows in zip(drawn_units, kept, strict=True))
    deviations = moves.deviations[kept[0]] * [source.standard_uncertainty for source in sources]
    columns = _columns(unknowns, all_sources)
    draws = rounded(np.column_stack([*columns.values(), deviations]))
    columns = dict(zip(columns, draws.T, strict=False))
    values, alone = _columns(unknowns, moves.unit[None]), _columns(unknowns, fit_alone)

    def estimated(name: str, unit: str) -> Quantity:
        return quantity(values[name][0], unit, columns[name], rounded(alone[name]))

    moduli = [rounded(_modulus(law, unknowns, units)) for units in (moves.unit[None], all_sources, fit_alone)]
    return {
        "parameters": {name: estimated(name, unit) for name, unit in zip(law.parameter_names, law.units, strict=True)},
        "initial_shear_modulus": quantity(_modulus(law, unknowns, moves.unit[None])[0], "Pa", *moduli[1:]),
        "bulk_modulus": estimated(_BULK, "Pa") if unknowns.space.has_bulk else None,
        "freed": tuple(FreedNuisance(n.name, n.datasets, estimated(n.name, n.unit), n.spread) for n in unknowns.freed),
        "draws": Draws(
            seed,
            (*columns, *(source.name for source in sources)),
            tuple(map(tuple, draws.tolist())),
        ),
    }


def _columns(unknowns: Unknowns, units: Array) -> dict[str, Array]:
    # Scaled values (P, n) in physical units, as one array (P,) for each name.
    parameters, bulk = unknowns.parameters(units), unknowns.bulk_modulus_Pa(units)
    columns = dict(zip(unknowns.space.law.parameter_names, parameters.T, strict=True))
    if bulk is not None:
        columns[_BULK] = bulk
    return columns | {n.name: n.value(units[:, i]) for i, n in enumerate(unknowns.freed, unknowns.searched)}


def _identifiability(
    problem: Problem,
    about: Linearisation,
    explained: Explained,
    covariance: Array,
    remaining: Array,
    ends: Ends,
    modulus: Quantity,
) -> Identifiability:
    unknowns = problem.unknowns
    names, space = unknowns.names, unknowns.space
    correlation = covariance / np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    eigen = directions(names, about.information + about.law_prior_information, about.prior)
    open_coordinates = np.arange(len(names)) < unknowns.searched
    open_coordinates &= remaining > NOT_FIXED
    open_coordinates[0] |= is_open(modulus)
    not_fixed = tuple(name for name, is_so in zip(space.names, open_coordinates, strict=False) if is_so)
    held = held_by_bounds(_slopes(unknowns, about.unit), covariance, open_coordinates)
    return Identifiability(
        statement=statement(
            names,
            unknowns.searched,
            not_fixed,
            correlation,
            eigen,
            unknowns.ratios,
            remaining.tolist(),
            modulus,
            bool(problem.priors),
        ),
        not_fixed=not_fixed,
        held_by_bounds=tuple(name for name, is_so in zip(space.law.parameter_names, held, strict=True) if is_so),
        at_bound=tuple(
            name for name, u in zip(space.names, about.unit, strict=False) if u < _AT_BOUND or u > 1 - _AT_BOUND
        ),
        residual_mm=about.residual_mm,
        correlation_points=about.points / about.independent_points,
        points=about.points,
        independent_points=about.independent_points,
        noise_mm=about.noise_mm,
        noise_points=about.noise_points,
        stated_squares=explained.squares,
        names=names,
        correlation=tuple(tuple(row) for row in correlation.tolist()),
        directions=eigen,
        profiled=tuple(names[i] for i in ends.profiled),
    )


def _slopes(unknowns: Unknowns, unit: Array) -> Array:
    # (m, n): derivatives of the m parameters of the law in the n unknowns, scaled to 0..1.
    step = _SLOPE_STEP * np.eye(len(unit))
    ahead, behind = np.minimum(unit + step, 1.0), np.maximum(unit - step, 0.0)
    difference = unknowns.parameters(ahead) - unknowns.parameters(behind)
    return np.asarray(difference / np.diag(ahead - behind)[:, None]).T
