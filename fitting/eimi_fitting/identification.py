"""Evolutionary identification: CMA-ES searches the parameters whose simulated edges lie on the measured ones.

After Di Lecce et al. 2022 (Front. Robot. AI 8:790571): a search on a coarse mesh, a polish on a finer one, another with
what a still finer one changes in the edges, and what the numbers are worth.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.coarse import coarsened
from eimi_fitting.credibility import check_explained, doubts
from eimi_fitting.experiment import DISCARDED_MM, Experiment
from eimi_fitting.linearised import independent_points
from eimi_fitting.materials import LAWS, Law
from eimi_fitting.mesh_error import mesh_corrected
from eimi_fitting.nuisance import Prior, nuisances
from eimi_fitting.polish import Polish, polish
from eimi_fitting.problem import INDEPENDENT_A_STATE, Problem
from eimi_fitting.search import Generation, Run, Told, search
from eimi_fitting.search_space import SEARCH_SPACES, SearchSpace
from eimi_fitting.stability import LARGEST_STRETCH_CHECKED, stable_up_to
from eimi_fitting.tensile_evidence import TensileCurve, TensileEvidence
from eimi_fitting.uncertainty import Uncertainty, estimate_uncertainty

Array = NDArray[np.float64]

_SAME_COUNT = 0.3  # of the logarithm of N: a prior that counts for that much more or less moves nothing worth a polish


@dataclass(frozen=True)
class Fit:
    """An identified law.

    parameters: (n,) in the law's own units; error_mm, deviation_mm: (K,) by state; stop: why the search ended;
    at_bound: search coordinates that ended on a bound; stable_to: largest stretch up to which the law is stable
    (None: no limit met); bulk_modulus_Pa: where it was freed; curves: the tensile curves and how well the law fits
    them alone, curve_rmse_Pa: and here; doubts: (experiment, state or None for all, words).
    """

    law: Law
    parameters: Array
    initial_shear_modulus_Pa: float
    bulk_modulus_Pa: float | None
    error_mm: Array
    deviation_mm: Array
    max_stretch: float
    uncertainty: Uncertainty
    curves: tuple[TensileEvidence, ...]
    curve_rmse_Pa: tuple[float, ...]
    doubts: tuple[tuple[int, int | None, str], ...]
    stable_to: float | None
    stability_checked_to: float
    at_bound: tuple[str, ...]
    history: tuple[Generation, ...]
    runs: tuple[Run, ...]
    polish: Polish
    evaluations: int
    unconverged: int
    unstable: int
    stop: str
    seed: int
    wall_s: float


class NothingConverged(Exception):
    """No candidate could be simulated: loads, geometry or observations do not fit together."""


def identify(
    model: str,
    experiments: Sequence[Experiment],
    *,
    free: Sequence[Prior] = (),
    free_bulk: bool = False,
    tensile: Sequence[TensileCurve] = (),
    seed: int = 1,
    population: int | None = None,
    most_generations: int = 400,
    restarts: int = 0,
    bipop: bool = False,
    replay: Sequence[Told] = (),
    progress: Callable[[Generation, Told], None] | None = None,
) -> Fit:
    """Identify one law (a key of LAWS) from one or several experiments.

    free: nuisances with their priors; free_bulk: the bulk modulus is searched too; tensile: curves that the law has to
    follow as well. The search runs on the coarse mesh of `BeamModel`'s defaults, with nuisances as stated; the polish,
    the errors and the intervals use the experiments' own models, corrected by what elements of half the size change in
    the edges (`eimi_fitting.mesh_error`). The search's options are those of `search`, which calls ``progress`` once a
    generation.

    Raises NothingConverged; NotExplained where a state's edges are nowhere near; CannotFit for a tensile curve;
    OtherSearch as `search` does; ValueError for a free bulk modulus in plane stress; KeyError for an unknown law.
    """
    begun = time.perf_counter()
    law, space = LAWS[model], SEARCH_SPACES[model]
    if free_bulk:
        if any(experiment.model.specimen.section == "plane-stress" for experiment in experiments):
            raise ValueError("in plane stress the law is exactly incompressible: no bulk modulus can be freed")
        space = space.with_bulk()
    problem = Problem(
        law,
        space,
        tuple(experiments),
        nuisances(free, len(experiments)),
        tuple(TensileEvidence.of(curve, model) for curve in tensile),
    )
    coarse = coarsened(experiments)
    guessed = INDEPENDENT_A_STATE * sum(len(experiment.loads) for experiment in experiments)
    found = search(
        lambda units: problem.judge(units, guessed, coarse),
        len(space.names),
        seed=seed,
        population=population,
        most_generations=most_generations,
        restarts=restarts,
        bipop=bipop,
        replay=replay,
        progress=progress,
    )
    if found.objective_mm >= DISCARDED_MM:
        raise NothingConverged(
            f"none of {found.evaluations} {model} candidates could be simulated: check geometry, loads and units"
        )

    polished = _polished(problem, found.unit)
    coarser_unit = best_unit = polished.unit
    corrected = mesh_corrected(experiments, lambda seen: problem.judge(coarser_unit[None], guessed, seen).comparison)
    if corrected:
        problem = replace(problem, experiments=corrected)
        best_unit = _polished(problem, coarser_unit).unit
    uncertainty = estimate_uncertainty(problem, best_unit, seed, best_unit - coarser_unit if corrected else None)
    final = problem.judge(best_unit[None], uncertainty.independent_points).comparison
    check_explained(final, experiments, bool(problem.curves))
    searched = best_unit[None, : problem.searched]
    parameters, bulk = space.parameters(searched), space.bulk_modulus_Pa(searched)
    return Fit(
        law,
        parameters[0],
        float(law.initial_shear_modulus(parameters)[0]),
        None if bulk is None else float(bulk[0]),
        final.error_mm[0],
        final.deviation_mm[0],
        float(final.max_stretch[0]),
        uncertainty,
        problem.curves,
        tuple(float(np.sqrt(np.mean(c.residuals_Pa(law, parameters) ** 2))) for c in problem.curves),
        tuple(doubts(final, experiments, corrected is not None)),
        stable_up_to(law, parameters[0]),
        LARGEST_STRETCH_CHECKED,
        _at_bound(space, best_unit),
        found.history,
        found.runs,
        polished,
        found.evaluations,
        found.unconverged,
        found.unstable,
        found.stop,
        seed,
        time.perf_counter() - begun,
    )


def _polished(problem: Problem, unit: Array) -> Polish:
    """Gauss-Newton over all unknowns; twice where the residuals decide how much else there is beside the edges."""
    if not problem.has_more_than_edges:
        return polish(lambda units: problem.judge(units, 1.0), unit)
    whole = problem.whole(unit)[0]

    def counted(at: Array) -> float:
        return independent_points(problem, problem.judge(at[None], 1.0).comparison.misfits)

    first_count = counted(whole)
    first = polish(lambda units: problem.judge(units, first_count), whole)
    second_count = counted(first.unit)
    if abs(np.log(second_count / first_count)) < _SAME_COUNT:
        return first
    second = polish(lambda units: problem.judge(units, second_count), first.unit)
    return replace(second, before_mm=first.before_mm, steps=first.steps + second.steps)


def _at_bound(space: SearchSpace, unit: Array) -> tuple[str, ...]:
    edge = 1e-3
    return tuple(name for name, u in zip(space.names, unit, strict=False) if u < edge or u > 1 - edge)
