"""Identify the parameters of a hyperelastic law for which simulated edges of a beam lie closest to measured edges.

CMA-ES searches on a coarse mesh, and Gauss-Newton improves the result. Three-dimensional models or finer meshes correct
the residuals, and Gauss-Newton is repeated. The intervals follow from the residuals and their derivatives at the
optimum. The method follows Di Lecce et al. 2022 (Front. Robot. AI 8:790571).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.doubts.cause_doubts import cause_doubts, is_as_stated
from eimi_fitting.inference.doubts.causes import weighed_causes
from eimi_fitting.inference.doubts.checks import (
    check_determined,
    check_explained,
    curve_doubts,
    doubts,
    prior_doubts,
    slip_doubts,
)
from eimi_fitting.inference.doubts.named_error import estimate_beside
from eimi_fitting.inference.doubts.possible_causes import PossibleCause
from eimi_fitting.inference.doubts.table_of_causes import POSSIBLE_CAUSES
from eimi_fitting.inference.evidence._coarse import coarsened
from eimi_fitting.inference.evidence.corrections import (
    polished,
    refinements,
)
from eimi_fitting.inference.evidence.experiment import DISCARDED_MM, Experiment
from eimi_fitting.inference.evidence.objective import Problem
from eimi_fitting.inference.evidence.parameter_priors import Prior, check_priors
from eimi_fitting.inference.evidence.polarity import freed_by_polarities
from eimi_fitting.inference.evidence.sources import SOURCES
from eimi_fitting.inference.evidence.tensile_curves import TensileCurve, TensileEvidence
from eimi_fitting.inference.evidence.unknowns import NuisancePrior, Unknowns, nuisances
from eimi_fitting.inference.identification.fit import Fit
from eimi_fitting.inference.interval.corrected_optimum import refine
from eimi_fitting.inference.searching.modulus_range import NothingConverged, narrowed, scanned, within
from eimi_fitting.inference.searching.named_causes import doubtful_loads
from eimi_fitting.inference.searching.search import (
    ENOUGH_MM,
    Generation,
    Objectives,
    SearchResult,
    search,
)
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.search_space import search_space
from eimi_fitting.laws.stability import LARGEST_STRETCH_CHECKED, stable_up_to

Array = NDArray[np.float64]

_INDEPENDENT_PER_STATE = 20.0  # guess of the independent points for the search; the polish estimates them
_ENOUGH = 0.14  # the search of a beam that hardly moves stops at this share of the objective of an unbent beam


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
    possible_causes: Sequence[PossibleCause] = POSSIBLE_CAUSES,
) -> Fit:
    """Identify the parameters of one hyperelastic law from one or several experiments.

    Parameters
    ----------
    model : str
        Name of the law, a key of `LAWS`.
    experiments : sequence of Experiment
        The experiments, fitted together.
    free : sequence of NuisancePrior
        Uncertain inputs that the fit determines together with the law, with their priors.
    free_bulk : bool
        Whether the fit also determines the bulk modulus.
    tensile : sequence of TensileCurve
        Tensile curves to fit together with the experiments.
    priors : sequence of Prior
        Priors on the parameters of the law.
    seed : int
        Seed of the random numbers.
    population : int, optional
        Number of candidate sets of parameters in a generation of the search.
    most_generations : int
        Largest number of generations in one run of the search.
    restarts : int
        Number of further runs of the search, each with twice as many candidates as the run before.
    bipop : bool
        Whether runs with few candidates follow each restart.
    replay : sequence of Objectives
        Results of an interrupted search, which are not computed again.
    progress : callable, optional
        Called after each generation with its results.
    possible_causes : sequence of PossibleCause
        Possible errors of the experiment, such as a tilted camera, that are compared with the residuals. Without them,
        the fit reports no cause of the residuals, and takes half of the time or less.

    Returns
    -------
    Fit
        The identified law.

    Raises
    ------
    NamedCause
        If no material explains the measurement because of a mistake in the loads.
    NothingActs
        If no load bends the specimen.
    NothingConverged
        If the beam could not be simulated with any values of the parameters.
    NotExplained
        If the simulated edges of a load case are far from the measured edges.
    NotDetermined
        If there is only one load case and it does not determine the modulus.
    CannotFit
        If the law cannot be fitted to a tensile curve.
    OtherSearch
        If ``replay`` contains the results of another search.
    ValueError
        If the bulk modulus is free and a section is not in plane strain, if an input in ``free`` has no standard
        uncertainty or belongs to a lens that a dataset does not describe, or if the law does not have the parameter of
        a prior.
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
    # A tensile curve in a wrong unit would give a range without the modulus of the beam.
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
    weighed = weighed_causes(problem, optimum, refined.effects, possible_causes)
    without_clamp = weighed.error_mm.get("clamp_offset")
    check_explained(
        final,
        experiments,
        without_clamp,
        bool(problem.curves),
        bool(optimum.evaluation.beyond[0]),
        [f"{prior.parameter} = {prior.in_words(problem.law)}" for prior in problem.priors],
    )
    due = refinements(experiments)
    named = cause_doubts(weighed, refined.estimate, final, experiments)
    beside = None
    if any(doubt.modulus_percent for doubt in named):
        names = [refinement.name for refinement in due]
        beside = estimate_beside(problem, optimum, refined.effects, weighed, refined.estimate, names, seed)
    estimated = beside or refined.estimate
    check_determined(estimated, experiments)
    in_problem = {effect.correction.refinement for effect in refined.effects}
    parameters = problem.unknowns.parameters(optimum.unit[None])
    curve_rmse_Pa = tuple(
        float(np.sqrt(np.mean(curve.residuals_Pa(problem.law, parameters) ** 2))) for curve in problem.curves
    )
    return Fit(
        **vars(estimated),
        law=problem.law,
        mean_error_mm=float(np.mean(final.error_mm[0])),
        mean_deviation_mm=float(np.mean(final.deviation_mm[0])),
        error_mm=final.error_mm[0],
        deviation_mm=final.deviation_mm[0],
        residuals_mm=tuple(np.where(m.weights > 0, m.residuals[0], np.nan) for m in final.misfits),
        max_stretch=refined.max_stretch,
        curves=problem.curves,
        curve_rmse_Pa=curve_rmse_Pa,
        priors=problem.priors,
        prior_distances=refined.prior_distances,
        doubts=(
            *slip_doubts(slips),
            *doubts(
                final,
                experiments,
                [*(r.doubt for r in due if r not in in_problem), *refined.not_considered],
                is_named=beside is not None,
                is_as_stated=is_as_stated(weighed, experiments),
            ),
            *named,
            *curve_doubts(problem.curves, curve_rmse_Pa),
            *prior_doubts(problem.priors, refined.prior_distances),
        ),
        causes=weighed.causes,
        stable_to=stable_up_to(problem.law, parameters[0]),
        stability_checked_to=LARGEST_STRETCH_CHECKED,
        generations=len(result.history),
        history=result.history,
        runs=result.runs,
        polish=refined.polish,
        evaluations=result.evaluations,
        discarded=result.discarded,
        stop=result.stop,
        seed=seed,
        wall_s=time.perf_counter() - start_s,
    )


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
        sections = {experiment.model.specimen.section for experiment in experiments}
        if others := sorted(sections - {"plane-strain"}):
            raise ValueError(
                "the fit can determine the bulk modulus only if the section is plane-strain; "
                f"the section is {', '.join(others)}"
            )
        space = space.with_bulk()
    _check_views(free, experiments)
    # States in a field of both polarities determine more inputs.
    freed = (*free, *freed_by_polarities(experiments, free))
    return Problem(
        law,
        Unknowns(space, nuisances(freed, len(experiments), [e.stated for e in experiments])),
        tuple(polished(e) for e in experiments),
        tuple(TensileEvidence.of(curve, model) for curve in tensile),
        tuple(priors),
    )


def _check_views(free: Sequence[NuisancePrior], experiments: Sequence[Experiment]) -> None:
    # Without a view, an error of the lens changes no residual.
    for prior in free:
        without = [index for index, experiment in enumerate(experiments) if experiment.view is None]
        if SOURCES[prior.kind].lens and without:
            raise ValueError(
                f"{prior.kind}: dataset {without[0]} has no edges with a view, and cannot determine this input"
            )


def _search(coarse: Problem, independent_points: float, **options: Any) -> SearchResult:
    result = search(
        lambda units: coarse.evaluate(units, independent_points),
        coarse.unknowns.searched,
        **options,
    )
    if result.objective_mm >= DISCARDED_MM:
        raise NothingConverged(
            f"none of the {result.evaluations} candidates for the parameters of {coarse.law.name} could be simulated: "
            "check geometry, loads and units"
        )
    return result
