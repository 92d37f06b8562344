"""Identify the parameters of a law: find those whose simulated edges lie on the measured ones.

The method follows Di Lecce et al. 2022 (Front. Robot. AI 8:790571):

1. CMA-ES searches on a coarse mesh (`inference.searching`).
2. Gauss-Newton improves the best candidate (`inference.searching.polish`).
3. Better models correct the residuals, and Gauss-Newton is repeated (`inference.evidence.corrections`).
4. The intervals follow from the evidence at the optimum (`inference.interval`).
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

_INDEPENDENT_PER_STATE = 20.0  # guess of the independent points for the search; the polish estimates them
# Change of log N below which the polish is not repeated. Measured with moment and roll freed on a virtual specimen: the
# optimum moves by at most 0.004 standard deviations.
_SAME_COUNT = 0.3
# The correction by the solid is repeated while it moves the modulus by at least 0.05 per cent, at most three times. A
# pass that raises the error by more than a hundredth is not accepted.
_STAYS_PERCENT, _MOST_PASSES, _NOT_WORSE = 0.05, 3, 1.01
# Smallest remaining error of the solid, in per cent of the modulus. Its mesh contributes at most 0.1 for the specimens
# of `benchmarks.solid_mesh`; the tolerance of Newton's method and the interpolated states contribute the rest.
_UNSURE_PERCENT = 0.15
_ENOUGH = 0.14  # the search of a beam that hardly moves stops at this share of the objective of an unbent beam
_LOOSE = 1e-2  # share of the objective at which a polish stops before the corrections are computed


@dataclass(frozen=True, kw_only=True)
class Fit(Estimate):
    """An identified law: an `Estimate` with its residuals, its doubts and the history of its search.

    Parameters
    ----------
    law : Law
        The law.
    error_mm, deviation_mm : ndarray, shape (K,)
        Error and deviation of each state.
    residuals_mm : tuple of ndarray, shape (K, G, m)
        Residuals of each experiment, see `Misfit`; NaN for points that were not measured.
    max_stretch : float
        Largest stretch on the meshes of the experiments.
    curves : tuple of TensileEvidence
        The tensile curves with their noise.
    curve_rmse_Pa : tuple of float
        Root mean square residuals of the tensile curves in this fit.
    priors : tuple of Prior
        Priors on the law's parameters.
    doubts : tuple of Doubt
        Doubts about the result.
    stable_to : float or None
        Largest stretch up to which the law is stable; None if it is stable up to ``stability_checked_to``.
    stability_checked_to : float
        Largest stretch that was checked.
    history, runs, evaluations, discarded, stop
        History of the search, see `SearchResult`.
    polish : Polish
        Improvement by the first polish.
    seed : int
        Seed of search and draws.
    wall_s : float
        Duration in seconds.

    Examples
    --------
    `identify` returns a ``fit``. Its most important values are

    - ``fit.initial_shear_modulus.value`` and its ``interval_95``, in Pa,
    - ``fit.parameters["mu"]`` and the other parameters,
    - ``fit.identifiability.statement``, a summary of what the data determine.

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
        """The parameters in the order and the units of the law, (n,)."""
        return np.array([quantity.value for quantity in self.parameters.values()])

    @property
    def mean_error_mm(self) -> float:
        """Mean error over all states, in mm."""
        return float(np.mean(self.error_mm))

    @property
    def mean_deviation_mm(self) -> float:
        """Mean deviation over all states, in mm."""
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

    The search runs on the default mesh of `BeamModel`, with nuisances at their stated values. A scan determines the
    range of moduli (`inference.searching.modulus_range`). The errors and intervals are those of better models than the
    models of the experiments (`inference.evidence.corrections`).

    Parameters
    ----------
    model : str
        A key of `LAWS`.
    experiments : sequence of Experiment
        The experiments, fitted together.
    free : sequence of NuisancePrior
        Nuisances to free, with their priors.
    free_bulk : bool
        Search the bulk modulus too.
    tensile : sequence of TensileCurve
        Tensile curves to fit together with the experiments.
    priors : sequence of Prior
        Priors on the law's parameters.
    seed, population, most_generations, restarts, bipop, replay, progress
        Options of the search, see `inference.searching.search.search`. The seed is also that of the draws.

    Returns
    -------
    Fit
        The identified law.

    Raises
    ------
    NamedCause
        A mistake in the loads is the reason why no material explains the measurement.
    NothingActs
        No load bends the specimen in any state.
    NothingConverged
        No candidate could be simulated.
    NotExplained
        The simulated edges of a state are far from the measured ones.
    NotDetermined
        There is one state only, and it does not determine the modulus.
    CannotFit
        The law cannot be fitted to a tensile curve.
    OtherSearch
        ``replay`` belongs to another search.
    ValueError
        For a free bulk modulus unless the section is in plane strain, for a nuisance without a stated uncertainty, and
        for a prior on a parameter that the law does not have.
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
    >>> observed = PointObservation(np.tile(rest, (2, 1, 1)), moved, np.full((2, 9), 0.01))
    >>> fit = identify("neo-hookean", [Experiment(model, loads, observed)])
    >>> bool(abs(fit.parameters["mu"].value - 46e3) < 1000)
    True
    """
    start_s = time.perf_counter()
    stated = _problem(model, experiments, free, free_bulk, tensile, priors)
    coarse = replace(stated, experiments=coarsened(stated.experiments))
    guessed_points = _INDEPENDENT_PER_STATE * sum(len(experiment.loads) for experiment in experiments)
    beam_alone = replace(coarse, curves=(), priors=())
    scan = narrowed(beam_alone, scanned(beam_alone, guessed_points), guessed_points)
    slips = doubtful_loads(beam_alone, scan, guessed_points)
    bounds_Pa = scan.searched()
    problem = within(stated, bounds_Pa)
    result = _search(
        within(coarse, bounds_Pa),
        guessed_points,
        seed=seed,
        population=population,
        most_generations=most_generations,
        restarts=restarts,
        bipop=bipop,
        enough_mm=min(ENOUGH_MM, _ENOUGH * scan.unmoved_mm),
        replay=replay,
        progress=progress,
    )
    refined = refine(problem, result.unit, seed)
    problem, optimum = refined.problem, refined.optimum
    final = optimum.evaluation.comparison
    # Where a freed source changes the specimen the candidates have no mesh in common, but the optimum has one.
    alone = final if final.shapes else problem.evaluate(optimum.unit[None], guessed_points).comparison
    common = common_errors(alone.shapes, final.misfits, optimum.distance, problem.experiments, problem.unknowns)
    check_explained(final, experiments, common, bool(problem.curves), bool(optimum.evaluation.beyond[0]))
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
            *common_doubts(final, common),
            *curve_doubts(problem.curves, curve_rmse_Pa),
            *prior_doubts(problem.priors, refined.estimate.prior_distances),
        ),
        stable_to=stable_up_to(problem.law, parameters[0]),
        stability_checked_to=LARGEST_STRETCH_CHECKED,
        history=result.history,
        runs=result.runs,
        polish=refined.polish,
        evaluations=result.evaluations,
        discarded=result.discarded,
        stop=result.stop,
        seed=seed,
        wall_s=time.perf_counter() - start_s,
    )


@dataclass(frozen=True)
class SearchEnd:
    """The end of all steps that follow a search.

    Parameters
    ----------
    problem : Problem
        The problem with its corrections.
    optimum : Optimum
        Its optimum.
    effects : tuple of Effect
        The moves of the optimum by the corrections.
    max_stretch : float
        Largest stretch on the meshes of the experiments.
    polish : Polish
        Improvement by the first polish.
    estimate : Estimate
        The unknowns with their intervals.
    """

    problem: Problem
    optimum: Optimum[Evaluation]
    effects: tuple[Effect, ...]
    max_stretch: float
    polish: Polish
    estimate: Estimate


def refine(problem: Problem, unit: Array, seed: int) -> SearchEnd:
    """Compute optimum, corrections and intervals from a candidate near the optimum.

    A polish varies the parameters on a planar model with the mesh of the search, or for a solid with the mesh of the
    solid. Its residuals are corrected to those of the finer meshes or of the solid.

    Parameters
    ----------
    problem : Problem
        The problem.
    unit : ndarray, shape (n,)
        The candidate in unit coordinates.
    seed : int
        Seed of the draws.

    Returns
    -------
    SearchEnd
        The optimum with its corrections and intervals.
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
            raise ValueError("the bulk modulus can be free in plane strain only: another section was stated")
        space = space.with_bulk()
    return Problem(
        law,
        Unknowns(space, nuisances(free, len(experiments), [e.stated for e in experiments])),
        tuple(polished(e) for e in experiments),
        tuple(TensileEvidence.of(curve, model) for curve in tensile),
        tuple(priors),
    )


def _search(coarse: Problem, independent_points: float, **options: Any) -> SearchResult:
    """Run the search on the coarse mesh; raise NothingConverged if no candidate is valid."""
    result = search(
        lambda units: coarse.evaluate(units, independent_points),
        coarse.unknowns.searched,
        **options,
    )
    if result.objective_mm >= DISCARDED_MM:
        raise NothingConverged(
            f"none of {result.evaluations} {coarse.law.name} candidates could be simulated: "
            "check geometry, loads and units"
        )
    return result


def _polished(
    problem: Problem, unit: Array, start: tuple[Evaluation, Array] | None = None, enough: float = ENOUGH
) -> Optimum[Evaluation]:
    """Minimise over all unknowns by Gauss-Newton.

    The weight of evidence besides the edges depends on the number N of independent points. N is estimated from the
    residuals, and the polish is repeated if N has changed.
    """
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
    """Correct the coarse problem to the problem's meshes and then to finer ones.

    Returns
    -------
    tuple
        The corrected problem, its optimum, the move of the optimum by the finer meshes, and the largest stretch (1,) on
        the problem's meshes. If one of the meshes finds no equilibrium, the results of the step before it.
    """
    plain = _alone(problem, optimum.unit, problem.experiments, keep=True)
    if plain.unconverged[0]:
        return coarse, optimum, (), plain.max_stretch
    first, reached = _with_residuals_of(plain, coarse, optimum)
    at = partial(_alone, problem, reached.unit)
    plain = at(problem.experiments, plain.shapes)
    mesh = correction(FINER_MESH, problem.experiments, plain, at)
    if mesh is None:
        return first, reached, (), plain.max_stretch
    finer, optimum = _with_residuals_of(mesh.better, first, reached)
    return finer, optimum, (Effect(mesh, optimum.unit - reached.unit),), plain.max_stretch


def _with_residuals_of(
    better: Comparison, now: Problem, optimum: Optimum[Evaluation]
) -> tuple[Problem, Optimum[Evaluation]]:
    """Return the problem with the residuals of a better model at its optimum, and the new optimum."""
    experiments = with_residuals_of(better, now.experiments, optimum.evaluation.comparison)
    return _with_change(replace(now, experiments=experiments), now, optimum)


def _with_solids(
    problem: Problem, optimum: Optimum[Evaluation]
) -> tuple[Problem, Optimum[Evaluation], tuple[Effect, ...]]:
    """Return the problem corrected by solids and finer meshes, its optimum, and the moves of the optimum."""
    # The solid comes first. The optimum of the planar model alone compensates for depth by the law, and the finer mesh
    # may find no equilibrium for such a law.
    plain = problem.experiments
    problem, optimum, effects = _with_depth(problem, optimum)
    unit = optimum.unit
    mesh = _change(problem, FINER_MESH, plain, unit) if FINER_MESH in refinements(plain) else None
    if mesh is not None:
        problem, optimum = _with_change(replace(problem, experiments=mesh.added(problem.experiments)), problem, optimum)
        effects.append(Effect(mesh, optimum.unit - unit))
    return problem, optimum, tuple(effects)


def _with_depth(problem: Problem, optimum: Optimum[Evaluation]) -> tuple[Problem, Optimum[Evaluation], list[Effect]]:
    """Correct the problem by the solid, and repeat the correction at each new optimum until the modulus stays.

    A further pass is accepted only if it does not raise the error. The move of a pass that is not accepted remains
    uncertain.
    """
    corrected, first, solid = problem, optimum.unit, None
    moved = np.inf
    for passes in range(_MOST_PASSES):
        further = _change(problem, SOLID, problem.experiments, optimum.unit, solid)
        if further is None:
            break
        changed = replace(problem, experiments=further.added(problem.experiments))
        trial, reached = _with_change(changed, corrected, optimum)
        moved = problem.unknowns.modulus_percent(reached.unit[0] - optimum.unit[0])
        if passes and reached.evaluation.objective_mm[0] > _NOT_WORSE * optimum.evaluation.objective_mm[0]:
            break
        corrected, optimum, solid = trial, reached, further
        if abs(moved) < _STAYS_PERCENT:
            break
    if solid is None:
        return problem, optimum, []
    whole = optimum.unit - first
    percent = abs(problem.unknowns.modulus_percent(whole[0]))
    share = min(max(SOLID.remaining_share, abs(moved) / max(percent, 1e-9)), 1.0)
    return corrected, optimum, [Effect(solid, whole, share, _UNSURE_PERCENT)]


def _with_change(changed: Problem, now: Problem, optimum: Optimum[Evaluation]) -> tuple[Problem, Optimum[Evaluation]]:
    """Return ``changed``, which differs from ``now`` in its changes only, and its optimum."""
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
    result = correction(refinement, experiments, at(experiments), at, [start] if start else ())
    return result and result.without_shapes()


def _alone(
    problem: Problem, unit: Array, experiments: Sequence[Experiment], near: Sequence[Shapes] = (), keep: bool = False
) -> Comparison:
    """Compare one candidate alone: rounding depends on the batch, and changes by a better model are small."""
    return problem.evaluate(unit[None], 1.0, experiments, near, keep).comparison
