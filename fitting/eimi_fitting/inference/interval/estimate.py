"""What the data say of the unknowns: values with intervals, and which combinations they fix.

Linearised about the optimum (`inference.interval.covariance`): the noise level from the residuals themselves, tau alike
points of edges counting as one; tracked points carry their own stated uncertainty, taken as common to the points of
one state. Where the objective is not the quadratic that this takes it for, the profile likelihood gives the ends
(`inference.interval.profile_likelihood`). What a better model would still change is in the intervals
(`inference.evidence.corrections`).

A direction that the data do not fix is held by the bounds of the search, entered as a normal prior with the bounds'
variance; it is named as not fixed. What specimen and calibration state as uncertain is in the intervals, freed or not
(`inference.interval.considered`); what nobody states is taken as exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import special

from eimi_fitting.inference.evidence.corrections import Correction
from eimi_fitting.inference.evidence.experiment import DISCARDED_MM
from eimi_fitting.inference.evidence.measurements import EdgeObservation
from eimi_fitting.inference.evidence.objective import Evaluation, Problem
from eimi_fitting.inference.evidence.quantity import Quantity
from eimi_fitting.inference.evidence.sources import SOURCES
from eimi_fitting.inference.evidence.unknowns import Unknowns
from eimi_fitting.inference.interval.budget import BudgetEntry, MeasureNext, Moves, budget
from eimi_fitting.inference.interval.considered import ConsideredSources, considered, sources_of, steps_of
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
from eimi_fitting.inference.interval.noise import Explained, linearise_noise
from eimi_fitting.inference.interval.profile_likelihood import Ends, interval_ends, moved_to
from eimi_fitting.inference.searching.polish import Optimum
from eimi_fitting.laws.law import Law

Array = NDArray[np.float64]

# A material is called compressible only where the objective has risen this many times as far as an interval's end asks,
# when it is taken as incompressible: an error of the mesh as large as the noise looks like some compressibility.
# Measured on four virtual specimens, whose material is incompressible: 5.3, 3.1, 0.8 and 0.7 times as far.
_PRETENDED = 10.0
_NORMAL = float(special.ndtri(0.975))
_BULK = "bulk_modulus"
_AT_BOUND = 1e-3  # of a coordinate's range
_SLOPE_STEP = 1e-4  # of it too


@dataclass(frozen=True)
class FreedNuisance:
    """A nuisance that was freed: by how much it is off what was stated, beside the prior's standard deviation.

    datasets: those that it is of, counted from 0 in the order given.
    """

    name: str
    datasets: tuple[int, ...]
    deviation: Quantity
    prior_standard_deviation: float


@dataclass(frozen=True)
class Effect:
    """How far a correction moved the optimum: (n,) in unit coordinates; left: which share of that is uncertain still.

    Of its refinement, unless given. least_percent: of the modulus, what is uncertain at least.
    """

    correction: Correction
    moved: Array
    share: float | None = None
    least_percent: float = 0.0

    @property
    def left(self) -> float:
        """See above."""
        return self.correction.refinement.left if self.share is None else self.share


@dataclass(frozen=True)
class CorrectionEffect:
    """What a correction changed in the initial shear modulus, and the half-width left in its interval for the rest.

    Both in per cent of it; None where the better model found no solution.
    """

    change_percent: float | None
    left_percent: float | None


@dataclass(frozen=True)
class Estimate:
    """The unknowns with their 95 % intervals, and what they are worth.

    parameters: the law's own, by name and in its order; bulk_modulus: where it was freed; corrections: by the name of
    the refinement; held_out_error_mm: mean error of states left out of the fit, with the sources where they explain
    most, None where there is one alone; budget: of the interval of the modulus, largest first; not_considered: what is
    said of sources that are not in the intervals; prior_distances: of the priors on the law's parameters, see
    `Linearisation.prior_distances`; draws: of the joint distribution, whose quantiles the intervals are.
    """

    parameters: dict[str, Quantity]
    initial_shear_modulus: Quantity
    bulk_modulus: Quantity | None
    freed: tuple[FreedNuisance, ...]
    identifiability: Identifiability
    corrections: dict[str, CorrectionEffect]
    held_out_error_mm: float | None
    budget: tuple[BudgetEntry, ...]
    measure_next: MeasureNext
    not_considered: tuple[str, ...]
    prior_distances: tuple[float, ...]
    draws: Draws


def estimate(
    problem: Problem, optimum: Optimum[Evaluation], effects: Sequence[Effect], refinements: Sequence[str], seed: int
) -> Estimate:
    """What the problem says at its optimum; the draws behind the intervals need a seed.

    effects: of the corrections that are in the problem; refinements: all that were tried. Costs the candidates of the
    intervals' ends.
    """
    unknowns, unit = problem.unknowns, optimum.unit
    sources = considered(problem, unit)
    model_mm = _model_mm(optimum, effects) if sources else None
    noise_told = linearise_noise(problem, optimum, sources, model_mm)
    about, explained = noise_told.about, noise_told.explained
    covariance = about.covariance(_widened(problem, about))
    spread = np.sqrt(np.diag(covariance))
    left, alone = _left(unknowns, about, effects)
    looked_at = (spread * np.sqrt(unknowns.prior))[: unknowns.searched] <= NOT_FIXED
    if unknowns.space.has_bulk:  # without an end above, and far from linear toward its lower one
        looked_at[-1] = True
    ends = _ends(problem, about, optimum, _NORMAL * spread, tuple(int(i) for i in np.flatnonzero(looked_at)))
    steps = steps_of(about, sources, covariance)
    everything = covariance + steps.sizes.T @ steps.sizes
    remaining = np.minimum(np.sqrt(np.diag(everything) * unknowns.prior), 1.0)
    if unknowns.space.has_bulk and ends.high[unknowns.searched - 1] >= 1.0:
        remaining[unknowns.searched - 1] = 1.0
    rng = np.random.default_rng(seed)
    noise = draw_noise(rng, unit, covariance, ends, left / _NORMAL, alone / _NORMAL)
    moves = Moves(unit, noise, normal_draws(rng, len(sources)), steps)
    entries, measure_next = budget(sources, moves, lambda units: _modulus(problem.law, unknowns, units))
    quantities = _quantities(problem.law, unknowns, moves, sources, seed)
    told = _identifiability(problem, about, explained, everything, remaining, ends, quantities["initial_shear_modulus"])
    return Estimate(
        **quantities,
        identifiability=replace(told, model_mm=float(np.concatenate(model_mm).mean()) if model_mm else 0.0),
        corrections=_effects_percent(unknowns, effects, refinements, left, alone),
        held_out_error_mm=held_out_error_mm(explained.states, explained.hessian),
        budget=entries,
        measure_next=measure_next,
        not_considered=tuple(
            f"with another {SOURCES[group.source].words}, of its stated uncertainty, the model finds no equilibrium: "
            "that uncertainty is not in the intervals"
            for group in sources_of(problem)
            if group not in {source.shared for source in sources}
        ),
        prior_distances=about.prior_distances(),
    )


def _model_mm(optimum: Optimum[Evaluation], effects: Sequence[Effect]) -> list[Array]:
    """(K,) of each experiment: standard deviation of what the corrections leave in the residuals."""
    found = []
    for index, misfit in enumerate(optimum.evaluation.comparison.misfits):
        counts = np.maximum(misfit.weights.sum(axis=(1, 2)), 1.0)
        squares = [
            (effect.left / _NORMAL) ** 2 * (effect.correction.changes[index] ** 2).sum(axis=(1, 2)) / counts
            for effect in effects
        ]
        found.append(np.sqrt(sum(squares, np.zeros(len(counts)))))
    return found


def _left(unknowns: Unknowns, about: Linearisation, effects: Sequence[Effect]) -> tuple[Array, Array]:
    """What the corrections leave uncertain, as bounds of 95 %: of the unknowns (C, n), and of the modulus alone (C,).

    An error of the model moves the optimum along one direction, by no more than this. Higher coefficients can take it
    upon themselves; the modulus is trusted no more than with them held.
    """
    left, alone = np.zeros((len(effects), len(about.unit))), np.zeros(len(effects))
    log_range = _log_range(unknowns)
    for c, effect in enumerate(effects):
        share = effect.left
        score = sum(own.score(change)[0] for own, change in zip(about.states, effect.correction.changes, strict=True))
        left[c] = share * effect.moved
        whole = max(abs(share * score / about.hessian[0, 0]), np.log1p(1e-2 * effect.least_percent) / log_range)
        alone[c] = np.sqrt(max(whole**2 - left[c, 0] ** 2, 0.0))
    return left, alone


def _log_range(unknowns: Unknowns) -> float:
    """Of the modulus, whose logarithm the first coordinate is."""
    return float(np.log(unknowns.space.upper[0] / unknowns.space.lower[0]))


def _effects_percent(
    unknowns: Unknowns, effects: Sequence[Effect], refinements: Sequence[str], left: Array, alone: Array
) -> dict[str, CorrectionEffect]:
    log_range = _log_range(unknowns)
    found = dict.fromkeys(refinements, CorrectionEffect(None, None))
    for effect, own, own_alone in zip(effects, left, alone, strict=True):
        found[effect.correction.refinement.name] = CorrectionEffect(
            100 * float(np.expm1(effect.moved[0] * log_range)), 100 * float(np.hypot(own[0], own_alone) * log_range)
        )
    return found


def _widened(problem: Problem, about: Linearisation) -> float:
    """Student's t over the normal quantile, where level and correlation of the noise are the residuals' own.

    As many residuals tell them as there are edges: one degree of freedom less than these (Bester, Conley and Hansen
    2011, J. Econometrics 165:137). Tracked points state theirs.
    """
    if not all(isinstance(e.observed, EdgeObservation) for e in problem.experiments):
        return 1.0
    edges = sum(own.residuals.shape[0] * own.residuals.shape[1] for own in about.states)
    freedom = max(min(about.noise_points - len(about.unit), edges - 1), 1.0)
    return float(special.stdtrit(freedom, 0.975)) / _NORMAL


def _ends(
    problem: Problem,
    about: Linearisation,
    optimum: Optimum[Evaluation],
    half_width: Array,
    looked_at: tuple[int, ...],
) -> Ends:
    """Interval ends by the objective itself, where it is not the quadratic that the covariance takes it for."""
    searched, known_squares = problem.unknowns.searched, float((about.known**2).sum())
    bounds_prior = np.where(np.arange(len(about.unit)) < searched, np.diag(about.prior), 0.0)

    def deviance(unit: Array) -> tuple[Array, Array]:
        candidates = problem.evaluate(unit, about.likelihood_points, near=optimum.evaluation.comparison.shapes)
        objective = candidates.without_known.objective_mm
        valid = objective < DISCARDED_MM
        moved = unit - about.unit
        # The sum of squares above its least in units of its variance: with a noise level that is unknown too, this is
        # what Student's t looks at (Seber and Wild 1989, section 5.3).
        ratio = np.where(valid, objective, np.inf) / about.objective_mm
        # The deviation of a prior is known: its part is the sum of squares itself.
        beside = (bounds_prior * moved**2).sum(axis=1) + (candidates.known**2).sum(axis=1) - known_squares
        value = about.likelihood_points * (ratio**2 - 1) + beside
        score = about.score_of(candidates) * np.where(valid, ratio, 1.0)[:, None]
        score += bounds_prior * moved + candidates.known @ about.known_slopes.T
        return np.where(valid, value, np.inf), score

    ends = interval_ends(deviance, about.unit, about.score, about.hessian, half_width, looked_at)
    bulk = searched - 1
    if problem.unknowns.space.has_bulk and ends.high[bulk] < 1.0:
        point, score = about.unit, about.score
        least = np.inf
        for _ in range(2):
            point = moved_to(point, score, about.hessian, bulk, 1.0)
            values, scores = deviance(point[None])
            score, least = scores[0], min(least, float(values[0]))
        target = half_width[bulk] ** 2 / np.linalg.inv(about.hessian)[bulk, bulk]
        if least < _PRETENDED * target:
            high = ends.high.copy()
            high[bulk] = 1.0
            return Ends(ends.low, high, tuple(sorted({*ends.profiled, bulk})))
    return ends


def _modulus(law: Law, unknowns: Unknowns, units: Array) -> Array:
    return law.initial_shear_modulus(unknowns.parameters(units))


def _quantities(
    law: Law, unknowns: Unknowns, moves: Moves, sources: Sequence[ConsideredSources], seed: int
) -> dict[str, Any]:
    """Parameters, initial shear modulus, bulk modulus and what was freed, and the draws that give their intervals."""
    own = moves.units(), moves.units(of_sources=0.0)
    kept = [thinned(_modulus(law, unknowns, units)) for units in own]
    all_of_it, fit_alone = (units[rows] for units, rows in zip(own, kept, strict=True))
    deviations = moves.deviations[kept[0]] * [source.standard_uncertainty for source in sources]
    columns = _columns(unknowns, all_of_it)
    every = rounded(np.column_stack([*columns.values(), deviations]))
    columns = dict(zip(columns, every.T, strict=False))
    values, alone = _columns(unknowns, moves.unit[None]), _columns(unknowns, fit_alone)

    def found(name: str, unit: str) -> Quantity:
        return quantity(values[name][0], unit, columns[name], rounded(alone[name]))

    moduli = [rounded(_modulus(law, unknowns, units)) for units in (moves.unit[None], all_of_it, fit_alone)]
    return {
        "parameters": {name: found(name, unit) for name, unit in zip(law.parameter_names, law.units, strict=True)},
        "initial_shear_modulus": quantity(_modulus(law, unknowns, moves.unit[None])[0], "Pa", *moduli[1:]),
        "bulk_modulus": found(_BULK, "Pa") if unknowns.space.has_bulk else None,
        "freed": tuple(FreedNuisance(n.name, n.datasets, found(n.name, n.unit), n.spread) for n in unknowns.freed),
        "draws": Draws(
            seed,
            (*columns, *(source.name for source in sources)),
            tuple(map(tuple, every.tolist())),
        ),
    }


def _columns(unknowns: Unknowns, units: Array) -> dict[str, Array]:
    """All that is unknown, (P,) each, of units (P, n)."""
    parameters, bulk = unknowns.parameters(units), unknowns.bulk_modulus_Pa(units)
    found = dict(zip(unknowns.space.law.parameter_names, parameters.T, strict=True))
    if bulk is not None:
        found[_BULK] = bulk
    return found | {n.name: n.value(units[:, i]) for i, n in enumerate(unknowns.freed, unknowns.searched)}


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
    eigen = directions(names, about.information + about.known_information, about.prior)
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
    """(m, n): of the law's parameters in the unit coordinates."""
    step = _SLOPE_STEP * np.eye(len(unit))
    ahead, behind = np.minimum(unit + step, 1.0), np.maximum(unit - step, 0.0)
    difference = unknowns.parameters(ahead) - unknowns.parameters(behind)
    return np.asarray(difference / np.diag(ahead - behind)[:, None]).T
