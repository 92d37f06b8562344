"""Evolutionary identification: CMA-ES searches the parameters whose simulated edges lie on the measured ones.

After Di Lecce et al. 2022 (Front. Robot. AI 8:790571): a search and a polish on a mesh that a population can afford,
another polish with what better models change in the edges, and what the numbers are worth.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.path import Shapes
from eimi_fitting.inference.doubts.checks import (
    Doubt,
    check_determined,
    check_explained,
    common_doubts,
    curve_doubts,
    doubts,
    prior_doubts,
    slip_doubts,
)
from eimi_fitting.inference.doubts.common_error import common_errors
from eimi_fitting.inference.evidence._coarse import coarsened, on_coarse_mesh
from eimi_fitting.inference.evidence.corrections import (
    FINER_MESH,
    SOLID,
    Correction,
    Refinement,
    correction,
    polished,
    refinements,
    with_residuals_of,
)
from eimi_fitting.inference.evidence.experiment import DISCARDED_MM, Comparison, Experiment
from eimi_fitting.inference.evidence.objective import Evaluation, Problem
from eimi_fitting.inference.evidence.parameter_priors import Prior, check_priors
from eimi_fitting.inference.evidence.tensile_curves import TensileCurve, TensileEvidence
from eimi_fitting.inference.evidence.unknowns import NuisancePrior, Unknowns, nuisances
from eimi_fitting.inference.interval.considered import considered
from eimi_fitting.inference.interval.covariance import independent_points
from eimi_fitting.inference.interval.estimate import Effect, Estimate, estimate
from eimi_fitting.inference.interval.noise import linearise_noise
from eimi_fitting.inference.searching.modulus_range import NothingConverged, narrowed, scanned, within
from eimi_fitting.inference.searching.named_causes import doubtful_loads
from eimi_fitting.inference.searching.polish import ENOUGH, Optimum, Polish, polish
from eimi_fitting.inference.searching.search import (
    ENOUGH_MM,
    Discards,
    Generation,
    Objectives,
    Run,
    SearchResult,
    search,
)
from eimi_fitting.laws import LAWS, Law
from eimi_fitting.laws.search_space import search_space
from eimi_fitting.laws.stability import LARGEST_STRETCH_CHECKED, stable_up_to

Array = NDArray[np.float64]

_INDEPENDENT_A_STATE = 20.0  # points: a guess for the search alone, which only the polish needs better
# Of the logarithm of N: a prior that counts for that much more or less moves nothing worth a polish. Measured with
# moment and roll freed on a virtual specimen: by no more than 0.004 standard deviations.
_SAME_COUNT = 0.3
# The solid's correction is found again where it moved the modulus by this much, in per cent, but not without end. A
# pass that raises the error by a hundredth is not taken.
_STAYS_PERCENT, _MOST_PASSES, _NOT_WORSE = 0.05, 3, 1.01
# Of the modulus: what the solid's mesh leaves at least, which is 0.1 at most for the specimens of
# `benchmarks.solid_mesh`, and what a Newton step of the tolerance and the states between leave.
_UNSURE_PERCENT = 0.15
_ENOUGH = 0.14  # of what the places lie off where nothing moves: the search of a beam that hardly moves ends there
_LOOSE = 1e-2  # of the objective: what a step gains before the corrections are known


@dataclass(frozen=True, kw_only=True)
class Fit(Estimate):
    """An identified law: what is known of it, the errors that it leaves, and how it was found.

    Beside what every `Estimate` holds: error_mm, deviation_mm: (K,) by state; residuals_mm: (K, G, m) of each
    experiment, see `Misfit`, NaN where nothing was measured; curves: the tensile curves and how well the law fits them
    alone, curve_rmse_Pa: and here; priors: on the law's own parameters; stable_to: largest stretch up to which the law
    is stable (None: no limit met); stop: why the search ended.

    Examples
    --------
    Made by `identify`; of a ``fit`` one reads

    - ``fit.initial_shear_modulus.value`` and its ``interval_95``, in Pa,
    - ``fit.parameters["mu"]`` and so on,
    - ``fit.identifiability.statement``, what the data fix in words.

    >>> from eimi_fitting import Fit
    >>> sorted(name for name in ("mean_error_mm", "values") if hasattr(Fit, name))
    ['mean_error_mm', 'values']
    """

    law: Law
    error_mm: Array
    deviation_mm: Array
    residuals_mm: tuple[Array, ...]
    max_stretch: float
    curves: tuple[TensileEvidence, ...]
    curve_rmse_Pa: tuple[float, ...]
    priors: tuple[Prior, ...] = ()
    doubts: tuple[Doubt, ...]
    stable_to: float | None
    stability_checked_to: float
    history: tuple[Generation, ...]
    runs: tuple[Run, ...]
    polish: Polish
    evaluations: int
    discarded: Discards
    stop: str
    seed: int
    wall_s: float

    @property
    def values(self) -> Array:
        """(n,): the parameters in the law's own order and units."""
        return np.array([quantity.value for quantity in self.parameters.values()])

    @property
    def mean_error_mm(self) -> float:
        """Of all states."""
        return float(np.mean(self.error_mm))

    @property
    def mean_deviation_mm(self) -> float:
        """Of all states."""
        return float(np.mean(self.deviation_mm))


def identify(
    model: str,
    experiments: Sequence[Experiment],
    *,
    free: Sequence[NuisancePrior] = (),
    free_bulk: bool = False,
    tensile: Sequence[TensileCurve] = (),
    priors: Sequence[Prior] = (),
    seed: int = 1,
    population: int | None = None,
    most_generations: int = 400,
    restarts: int = 0,
    bipop: bool = False,
    replay: Sequence[Objectives] = (),
    progress: Callable[[Generation, Objectives], None] | None = None,
) -> Fit:
    """Identify one law from one or several experiments.

    The search runs on the coarse mesh of `BeamModel`'s defaults, with nuisances as stated, over the moduli that a scan
    finds worth it (`inference.searching.modulus_range`); the errors and the intervals are those of better models than
    the experiments' own (`inference.evidence.corrections`).

    Parameters
    ----------
    model : str
        A key of `LAWS`.
    experiments : sequence of Experiment
        What was done and seen, fitted together.
    free : sequence of NuisancePrior
        Nuisances that are freed, with their priors.
    free_bulk : bool
        Search the bulk modulus too.
    tensile : sequence of TensileCurve
        Curves that the law has to follow as well.
    priors : sequence of Prior
        What is known of the law's own parameters, beside the data.
    seed, population, most_generations, restarts, bipop, replay, progress
        Of the search, see `inference.searching.search.search`; ``progress`` is called once a generation.

    Returns
    -------
    Fit

    Raises
    ------
    NamedCause
        A slip in the loads is why no material explains what was seen.
    NothingActs
        No load bends the specimen in any state.
    NothingConverged
        No candidate could be simulated.
    NotExplained
        A state's edges are nowhere near.
    NotDetermined
        One state alone, which leaves the modulus open.
    CannotFit
        For a tensile curve.
    OtherSearch
        ``replay`` is of another search.
    ValueError
        For a free bulk modulus in plane stress, for a nuisance whose uncertainty nobody states, and for a prior on a
        parameter that the law does not have.
    KeyError
        For an unknown law.

    Examples
    --------
    A strip of 46 kPa bends under tip forces of 1 and 2 mN; nine points along its middle line are tracked.

    >>> import numpy as np
    >>> from eimi_fitting import LAWS, BeamModel, Experiment, Loads, PointObservation, Specimen, identify
    >>> strip = Specimen(
    ...     length_mm=30.0, width_mm=3.0, depth_mm=10.0, density_kg_m3=1070.0, section="plane-stress"
    ... )
    >>> model = BeamModel(strip)
    >>> loads = Loads.along([0.0, 0.0], gravity_angle_deg=90.0, tip_force_N=[0.001, 0.002])
    >>> rest = np.column_stack([np.linspace(5, 29, 9), np.zeros(9)])
    >>> moved = model.positions(model.solve(LAWS["neo-hookean"], np.array([[46e3]]), loads), rest)[0]
    >>> seen = PointObservation(np.tile(rest, (2, 1, 1)), moved, np.full((2, 9), 0.01))
    >>> fit = identify("neo-hookean", [Experiment(model, loads, seen)])
    >>> bool(abs(fit.parameters["mu"].value - 46e3) < 1000)
    True
    """
    begun = time.perf_counter()
    stated = _problem(model, experiments, free, free_bulk, tensile, priors)
    coarse = replace(stated, experiments=coarsened(stated.experiments))
    guessed = _INDEPENDENT_A_STATE * sum(len(experiment.loads) for experiment in experiments)
    beam_alone = replace(coarse, curves=(), priors=())
    scan = narrowed(beam_alone, scanned(beam_alone, guessed), guessed)
    slips = doubtful_loads(beam_alone, scan, guessed)
    bounds_Pa = scan.searched()
    problem = within(stated, bounds_Pa)
    found = _search(
        within(coarse, bounds_Pa),
        guessed,
        seed=seed,
        population=population,
        most_generations=most_generations,
        restarts=restarts,
        bipop=bipop,
        enough_mm=min(ENOUGH_MM, _ENOUGH * scan.unmoved_mm),
        replay=replay,
        progress=progress,
    )
    refined = refine(problem, found.unit, seed)
    problem, optimum = refined.problem, refined.optimum
    final = optimum.evaluation.comparison
    # Where a freed source changes the specimen the candidates have no mesh in common, but the optimum has one.
    alone = final if final.shapes else problem.evaluate(optimum.unit[None], guessed).comparison
    alike = common_errors(alone.shapes, final.misfits, optimum.distance, problem.experiments, problem.unknowns)
    check_explained(final, experiments, alike, bool(problem.curves), bool(optimum.evaluation.beyond[0]))
    due = refinements(experiments)
    check_determined(refined.estimate, experiments)
    in_problem = {effect.correction.refinement for effect in refined.effects}
    parameters = problem.unknowns.parameters(optimum.unit[None])
    curve_rmse_Pa = tuple(
        float(np.sqrt(np.mean(curve.residuals_Pa(problem.law, parameters) ** 2))) for curve in problem.curves
    )
    return Fit(
        **vars(refined.estimate),
        law=problem.law,
        error_mm=final.error_mm[0],
        deviation_mm=final.deviation_mm[0],
        residuals_mm=tuple(np.where(m.weights > 0, m.residuals[0], np.nan) for m in final.misfits),
        max_stretch=refined.max_stretch,
        curves=problem.curves,
        curve_rmse_Pa=curve_rmse_Pa,
        priors=problem.priors,
        doubts=(
            *slip_doubts(slips),
            *doubts(
                final,
                experiments,
                [*(r.doubt for r in due if r not in in_problem), *refined.estimate.not_considered],
            ),
            *common_doubts(final, alike),
            *curve_doubts(problem.curves, curve_rmse_Pa),
            *prior_doubts(problem.priors, refined.estimate.prior_distances),
        ),
        stable_to=stable_up_to(problem.law, parameters[0]),
        stability_checked_to=LARGEST_STRETCH_CHECKED,
        history=found.history,
        runs=found.runs,
        polish=refined.polish,
        evaluations=found.evaluations,
        discarded=found.discarded,
        stop=found.stop,
        seed=seed,
        wall_s=time.perf_counter() - begun,
    )


@dataclass(frozen=True)
class SearchEnd:
    """Where the polishes led: the problem with its corrections, its optimum, what they moved, and what it is worth.

    max_stretch: on the experiments' own meshes.
    """

    problem: Problem
    optimum: Optimum[Evaluation]
    effects: tuple[Effect, ...]
    max_stretch: float
    polish: Polish
    estimate: Estimate


def refine(problem: Problem, unit: Array, seed: int) -> SearchEnd:
    """All that follows a search: polish, corrections and intervals, from unit coordinates (n,) near the optimum.

    A planar model follows small steps of the parameters on the mesh of the search, whose residuals are made those of
    the finer meshes; a solid's on the solid's own lines.
    """
    names = [refinement.name for refinement in refinements(problem.experiments)]
    if SOLID in refinements(problem.experiments):
        first = _polished(problem, unit, enough=_LOOSE)
        problem, optimum, effects = _with_solids(problem, first)
        stretch = optimum.evaluation.comparison.max_stretch
    else:
        coarse = replace(problem, experiments=on_coarse_mesh(problem.experiments))
        first = _polished(coarse, unit, enough=_LOOSE)
        problem, optimum, effects, stretch = _with_finer_meshes(problem, coarse, first)
    estimated = estimate(problem, optimum, effects, names, seed)
    return SearchEnd(problem, optimum, effects, float(stretch[0]), first.polish, estimated)


def _problem(
    model: str,
    experiments: Sequence[Experiment],
    free: Sequence[NuisancePrior],
    free_bulk: bool,
    tensile: Sequence[TensileCurve],
    priors: Sequence[Prior],
) -> Problem:
    law, space = LAWS[model], search_space(LAWS[model])
    check_priors(priors, law)
    if free_bulk:
        if any(experiment.model.specimen.section != "plane-strain" for experiment in experiments):
            raise ValueError("the search knows a bulk modulus in plane strain alone: no other section can free it")
        space = space.with_bulk()
    return Problem(
        law,
        Unknowns(space, nuisances(free, len(experiments), [e.stated for e in experiments])),
        tuple(polished(e) for e in experiments),
        tuple(TensileEvidence.of(curve, model) for curve in tensile),
        tuple(priors),
    )


def _search(coarse: Problem, independent_points: float, **options: Any) -> SearchResult:
    """The search on the coarse mesh. Raises NothingConverged."""
    found = search(
        lambda units: coarse.evaluate(units, independent_points),
        coarse.unknowns.searched,
        **options,
    )
    if found.objective_mm >= DISCARDED_MM:
        raise NothingConverged(
            f"none of {found.evaluations} {coarse.law.name} candidates could be simulated: "
            "check geometry, loads and units"
        )
    return found


def _polished(
    problem: Problem, unit: Array, start: tuple[Evaluation, Array] | None = None, enough: float = ENOUGH
) -> Optimum[Evaluation]:
    """Gauss-Newton over all unknowns; twice where the residuals decide how much else there is beside the edges."""
    if not problem.has_more_than_edges:
        return polish(problem.nearby(1.0), unit, start, enough)
    whole = problem.unknowns.whole(unit)[0]
    first_count = independent_points(problem, problem.evaluate(whole[None], 1.0).comparison.misfits)
    first = polish(problem.nearby(first_count), whole)
    second_count = linearise_noise(problem, first, considered(problem, first.unit)).about.likelihood_points
    if abs(np.log(second_count / first_count)) < _SAME_COUNT:
        return first
    second = polish(problem.nearby(second_count), first.unit)
    steps = first.polish.steps + second.polish.steps
    return replace(
        second, polish=replace(second.polish, mean_error_before_mm=first.polish.mean_error_before_mm, steps=steps)
    )


def _with_finer_meshes(
    problem: Problem, coarse: Problem, optimum: Optimum[Evaluation]
) -> tuple[Problem, Optimum[Evaluation], tuple[Effect, ...], Array]:
    """The coarse problem with the residuals of the problem's meshes, then with those of finer ones, and its optimum.

    And how far the finer ones moved it, and the largest stretch (1,) on the problem's meshes. Where one of them finds
    no equilibrium, what was reached before.
    """
    plain = _alone(problem, optimum.unit, problem.experiments, keep=True)
    if plain.unconverged[0]:
        return coarse, optimum, (), plain.max_stretch
    own, reached = _with_residuals_of(plain, coarse, optimum)
    at = partial(_alone, problem, reached.unit)
    plain = at(problem.experiments, plain.shapes)
    found = correction(FINER_MESH, problem.experiments, plain, at)
    if found is None:
        return own, reached, (), plain.max_stretch
    finer, optimum = _with_residuals_of(found.better, own, reached)
    return finer, optimum, (Effect(found, optimum.unit - reached.unit),), plain.max_stretch


def _with_residuals_of(
    better: Comparison, now: Problem, optimum: Optimum[Evaluation]
) -> tuple[Problem, Optimum[Evaluation]]:
    """The problem with a better model's residuals at its optimum, and the optimum that this leads to."""
    experiments = with_residuals_of(better, now.experiments, optimum.evaluation.comparison)
    return _with_change(replace(now, experiments=experiments), now, optimum)


def _with_solids(
    problem: Problem, optimum: Optimum[Evaluation]
) -> tuple[Problem, Optimum[Evaluation], tuple[Effect, ...]]:
    """The problem with all corrections that are found in it, its optimum, and how far each correction moved it."""
    # First depth: a law that is bent to follow what no plane does may be none for the mesh of what is planar.
    plain = problem.experiments
    problem, optimum, effects = _with_depth(problem, optimum)
    unit = optimum.unit
    found = _change(problem, FINER_MESH, plain, unit) if FINER_MESH in refinements(plain) else None
    if found is not None:
        problem, optimum = _with_change(
            replace(problem, experiments=found.added(problem.experiments)), problem, optimum
        )
        effects.append(Effect(found, optimum.unit - unit))
    return problem, optimum, tuple(effects)


def _with_depth(problem: Problem, optimum: Optimum[Evaluation]) -> tuple[Problem, Optimum[Evaluation], list[Effect]]:
    """The problem with what the solid changes at the optimum that this leads to.

    A further pass counts only where it does not raise the error; what it would have moved is then left.
    """
    corrected, first, found = problem, optimum.unit, None
    moved = np.inf
    for passes in range(_MOST_PASSES):
        further = _change(problem, SOLID, problem.experiments, optimum.unit, found)
        if further is None:
            break
        changed = replace(problem, experiments=further.added(problem.experiments))
        trial, reached = _with_change(changed, corrected, optimum)
        moved = problem.unknowns.modulus_percent(reached.unit[0] - optimum.unit[0])
        if passes and reached.evaluation.objective_mm[0] > _NOT_WORSE * optimum.evaluation.objective_mm[0]:
            break
        corrected, optimum, found = trial, reached, further
        if abs(moved) < _STAYS_PERCENT:
            break
    if found is None:
        return problem, optimum, []
    whole = optimum.unit - first
    percent = abs(problem.unknowns.modulus_percent(whole[0]))
    share = min(max(SOLID.remaining_share, abs(moved) / max(percent, 1e-9)), 1.0)
    return corrected, optimum, [Effect(found, whole, share, _UNSURE_PERCENT)]


def _with_change(changed: Problem, now: Problem, optimum: Optimum[Evaluation]) -> tuple[Problem, Optimum[Evaluation]]:
    """A problem that differs from ``now`` in its changes alone, and its optimum, beginning at that of ``now``."""
    start = changed.with_own_changes(optimum.evaluation, now), optimum.distance
    return changed, _polished(changed, optimum.unit, start)


def _change(
    problem: Problem,
    refinement: Refinement,
    experiments: Sequence[Experiment],
    unit: Array,
    start: Correction | None = None,
) -> Correction | None:
    at = partial(_alone, problem, unit)
    found = correction(refinement, experiments, at(experiments), at, [start] if start else ())
    return found and found.without_shapes()


def _alone(
    problem: Problem, unit: Array, experiments: Sequence[Experiment], near: Sequence[Shapes] = (), keep: bool = False
) -> Comparison:
    """Of one candidate alone: a change by a better model is small, and rounding differs with the size of a batch."""
    return problem.evaluate(unit[None], 1.0, experiments, near, keep).comparison
