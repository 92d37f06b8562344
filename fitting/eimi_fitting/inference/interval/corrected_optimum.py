"""Compute the optimum of a fit and its intervals, starting from the result of the global search.

1. Gauss-Newton improves the values of the unknowns.
2. Three-dimensional models, or planar models with finer meshes, correct the residuals. Gauss-Newton is repeated.
3. The intervals are computed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.path import Shapes
from eimi_fitting.inference.evidence._coarse import on_coarse_mesh
from eimi_fitting.inference.evidence.corrections import (
    FINER_MESH,
    SOLID,
    Correction,
    Refinement,
    correction,
    refinements,
    with_residuals_of,
)
from eimi_fitting.inference.evidence.experiment import DISCARDED_MM, Comparison, Experiment
from eimi_fitting.inference.evidence.objective import Evaluation, Problem
from eimi_fitting.inference.interval.covariance import independent_points
from eimi_fitting.inference.interval.estimate import Estimate, estimate
from eimi_fitting.inference.interval.noise import Effect, linearise_noise
from eimi_fitting.inference.searching.polish import ENOUGH, Optimum, Polish, polish

Array = NDArray[np.float64]

# Change of log N below which the polish is not repeated. Measured with moment and roll freed on a virtual specimen: the
# optimum moves by at most 0.004 standard deviations.
_SAME_COUNT = 0.3
# The correction by the solid is repeated while it moves the modulus by at least 0.05 per cent, at most three times. A
# pass that raises the error by more than a hundredth is not accepted.
_STAYS_PERCENT, _MOST_PASSES, _NOT_WORSE = 0.05, 3, 1.01
# Smallest remaining error of the solid, in per cent of the modulus. Its mesh contributes at most 0.1 for the specimens
# of `benchmarks.solid_mesh`; the tolerance of Newton's method and the interpolated states contribute the rest.
_UNSURE_PERCENT = 0.15
_TOWARD_MIDDLE = (0.25, 0.5, 0.75, 1.0)  # shares of the way to the middle of the bounds, for an unstable candidate
_LOOSE = 1e-2  # share of the objective at which a polish stops before the corrections are computed


@dataclass(frozen=True)
class SearchEnd:
    """The optimum of a fit, and the intervals of its unknowns."""

    # Its residuals are corrected for the errors of the beam model.
    problem: Problem
    optimum: Optimum[Evaluation]
    # Change of the optimum by each correction.
    effects: tuple[Effect, ...]
    # Largest stretch of the beam.
    max_stretch: float
    # The first run of Gauss-Newton.
    polish: Polish
    estimate: Estimate
    # Distance of each prior's mean from the value that all other data give, in standard deviations.
    prior_distances: tuple[float, ...]
    # One sentence for each uncertain input that the intervals do not contain.
    not_considered: tuple[str, ...]


def refine(problem: Problem, unit: Array, seed: int) -> SearchEnd:
    """Compute the optimum of a fit and its intervals, starting from the result of the global search."""
    # unit (n,): the unknowns at the start, scaled to 0..1 between their bounds. seed: for the random draws of the
    # intervals.
    names = [refinement.name for refinement in refinements(problem.experiments)]
    if SOLID in refinements(problem.experiments):
        # The planar model has the mesh of the three-dimensional model, which corrects it.
        first = _polished(problem, unit, enough=_LOOSE)
        if first.evaluation.objective_mm[0] >= DISCARDED_MM:
            first = _polished(problem, _valid(problem, unit), enough=_LOOSE)
        problem, optimum, effects = _with_solids(problem, first)
        stretch = optimum.evaluation.comparison.max_stretch
    else:
        # The planar model is solved on the coarse mesh of the search. Its result is then corrected with finer meshes.
        coarse = replace(problem, experiments=on_coarse_mesh(problem.experiments))
        first = _polished(coarse, unit, enough=_LOOSE)
        problem, optimum, effects, stretch = _with_finer_meshes(problem, coarse, first)
    noise = linearise_noise(problem, optimum, effects)
    return SearchEnd(
        problem,
        optimum,
        effects,
        float(stretch[0]),
        first.polish,
        estimate(problem, optimum, effects, noise, names, seed),
        noise.about.prior_distances(),
        noise.not_considered(problem),
    )


def _valid(problem: Problem, unit: Array) -> Array:
    # Find values near `unit` for which the beam is stable; without success, return `unit` itself.
    # The search used a coarse mesh. A finer mesh has larger stretches, at which the law may be unstable. All unknowns
    # but the first, the modulus, are moved toward the middle of their ranges.
    toward = np.full(len(unit), 0.5)
    toward[0] = unit[0]
    for share in _TOWARD_MIDDLE:
        trial = unit + share * (toward - unit)
        if problem.evaluate(trial[None], 1.0).objective_mm[0] < DISCARDED_MM:
            return np.asarray(trial)
    return unit


def _polished(
    problem: Problem, unit: Array, start: tuple[Evaluation, Array] | None = None, enough: float = ENOUGH
) -> Optimum[Evaluation]:
    if not problem.has_more_than_edges:
        return polish(problem.nearby(1.0), unit, start, enough)
    # The weight of curves and priors depends on the number of independent points, which follows from the residuals at
    # the optimum. A second run is needed if the first number was wrong.
    whole = problem.unknowns.whole(unit)[0]
    first_count = independent_points(problem, problem.evaluate(whole[None], 1.0).comparison.misfits)
    first = polish(problem.nearby(first_count), whole)
    second_count = linearise_noise(problem, first).about.likelihood_points
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
    # Fit with two finer meshes in turn. The last result is the largest stretch, (1,).
    plain = _alone(problem, optimum.unit, problem.experiments, keep=True)
    # A beam without an equilibrium on a finer mesh is not corrected.
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
    # Replace the residuals of a fit by those of a finer mesh.
    experiments = with_residuals_of(better, now.experiments, optimum.evaluation.comparison)
    return _with_change(replace(now, experiments=experiments), now, optimum)


def _with_solids(
    problem: Problem, optimum: Optimum[Evaluation]
) -> tuple[Problem, Optimum[Evaluation], tuple[Effect, ...]]:
    # The solid comes first. The optimum of the planar model alone compensates for the depth by a wrong law, and the
    # finer mesh may find no equilibrium for such a law.
    plain = problem.experiments
    problem, optimum, effects = _with_depth(problem, optimum)
    unit = optimum.unit
    # Beams in plane stress or plane strain are corrected by a finer mesh.
    mesh = _change(problem, FINER_MESH, plain, unit) if FINER_MESH in refinements(plain) else None
    if mesh is not None:
        problem, optimum = _with_change(replace(problem, experiments=mesh.added(problem.experiments)), problem, optimum)
        effects.append(Effect(mesh, optimum.unit - unit))
    return problem, optimum, tuple(effects)


def _with_depth(problem: Problem, optimum: Optimum[Evaluation]) -> tuple[Problem, Optimum[Evaluation], list[Effect]]:
    # Correct a fit with the planar model by the solid model, in up to three passes. There are no effects if the solid
    # has no equilibrium.
    corrected, first, solid = problem, optimum.unit, None
    moved = np.inf
    for passes in range(_MOST_PASSES):
        further = _change(problem, SOLID, problem.experiments, optimum.unit, solid)
        if further is None:
            break
        changed = replace(problem, experiments=further.added(problem.experiments))
        trial, reached = _with_change(changed, corrected, optimum)
        moved = problem.unknowns.modulus_percent(reached.unit[0] - optimum.unit[0])
        # A later pass that raises the objective is rejected.
        if passes and reached.evaluation.objective_mm[0] > _NOT_WORSE * optimum.evaluation.objective_mm[0]:
            break
        corrected, optimum, solid = trial, reached, further
        if abs(moved) < _STAYS_PERCENT:
            break
    # The three-dimensional model has no equilibrium.
    if solid is None:
        return problem, optimum, []
    whole = optimum.unit - first
    percent = abs(problem.unknowns.modulus_percent(whole[0]))
    # The change of the modulus in the last pass counts as a remaining error.
    share = min(max(SOLID.remaining_share, abs(moved) / max(percent, 1e-9)), 1.0)
    return corrected, optimum, [Effect(solid, whole, share, _UNSURE_PERCENT)]


def _with_change(changed: Problem, now: Problem, optimum: Optimum[Evaluation]) -> tuple[Problem, Optimum[Evaluation]]:
    # The search for the optimum of `changed` begins at the optimum of the fit `now`.
    start = changed.recorrected(optimum.evaluation, now), optimum.distance
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
    # Simulate the beam for one set of unknowns, (n,).
    # Other rounding errors, as in a simulation of several sets, would disturb the small differences between two beam
    # models.
    return problem.evaluate(unit[None], 1.0, experiments, near, keep).comparison
