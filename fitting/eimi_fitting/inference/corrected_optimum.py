"""Compute the optimum of a fit of a hyperelastic law from the best candidate of the search.

A candidate is a set of values of the unknowns. The steps are: improve the candidate by Gauss-Newton
(`inference.searching.polish`), correct the residuals by better beam models (`inference.evidence.corrections`), and
compute the intervals (`inference.interval`). The weight of tensile curves and priors depends on the noise of the edges.
Gauss-Newton is therefore repeated if the estimate of the noise has changed.
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
    """The optimum of a fit of a hyperelastic law, with corrections by better beam models and with intervals.

    Parameters
    ----------
    problem : Problem
        The law, the unknowns and the measurements of the fit, with the corrections of the residuals.
    optimum : Optimum
        The optimum of the corrected problem.
    effects : tuple of Effect
        The change of the optimum by each correction.
    max_stretch : float
        Largest stretch of the beam in any state at the optimum, computed with planar models on the meshes of the
        experiments.
    polish : Polish
        Improvement of the best candidate by the first run of Gauss-Newton.
    estimate : Estimate
        The unknowns with their intervals.
    prior_distances : tuple of float
        For each prior on a parameter of the law, the difference between the prior and the value that the other evidence
        (edges, tensile curves, other priors) gives, in standard deviations of this difference.
    not_considered : tuple of str
        One sentence for each source of uncertainty that the intervals do not contain.
    """

    problem: Problem
    optimum: Optimum[Evaluation]
    effects: tuple[Effect, ...]
    max_stretch: float
    polish: Polish
    estimate: Estimate
    prior_distances: tuple[float, ...]
    not_considered: tuple[str, ...]


def refine(problem: Problem, unit: Array, seed: int) -> SearchEnd:
    """Compute the optimum of a fit, with corrections and intervals, from a candidate near the optimum.

    Gauss-Newton varies the unknowns on a planar model. A better model is solved only at the optimum. The difference
    between the residuals of both models is added to the residuals of the planar model (a correction). For a section in
    plane stress or plane strain, the planar model has the coarse mesh of the search, and the better models have finer
    meshes. For a solid section, the planar model has the mesh of the three-dimensional model, which is the better
    model.

    Parameters
    ----------
    problem : Problem
        The law, the unknowns and the measurements of the fit.
    unit : ndarray, shape (n,)
        The candidate: n unknowns in unit coordinates, from 0 to 1 within the bounds of the search.
    seed : int
        Seed of the random draws for the intervals.

    Returns
    -------
    SearchEnd
        The optimum with its corrections and intervals.
    """
    names = [refinement.name for refinement in refinements(problem.experiments)]
    if SOLID in refinements(problem.experiments):
        first = _polished(problem, unit, enough=_LOOSE)
        if first.evaluation.objective_mm[0] >= DISCARDED_MM:
            first = _polished(problem, _valid(problem, unit), enough=_LOOSE)
        problem, optimum, effects = _with_solids(problem, first)
        stretch = optimum.evaluation.comparison.max_stretch
    else:
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
    """Return a candidate near ``unit`` (n,) that has a stable equilibrium in all states, if ``unit`` itself has none.

    A candidate is a set of values of the n unknowns, each from 0 to 1 between its bounds (unit coordinates). The search
    found ``unit`` on a coarse mesh. The finer mesh of ``problem`` has larger stretches, at which the law may be
    unstable. All coordinates but the first, which determines the modulus, are then moved toward 1/2 in four steps,
    until the law is stable. If no step helps, ``unit`` is returned.
    """
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
    """Return the optimum of a fit with n unknowns, computed by Gauss-Newton from the start ``unit`` (n,).

    The start has a value from 0 to 1 for each unknown (unit coordinates). If there is other evidence than edges, its
    weight depends on N, the number of independent edge points. N follows from the residuals at the optimum, which are
    not yet known. Gauss-Newton is therefore run with an estimate of N, and a second time if the N of its result
    differs from the estimate by more than a factor of e^0.3.

    If the edges are the only evidence, ``start`` may give an earlier evaluation of ``unit``, and Gauss-Newton stops
    after a step that lowers the objective by less than the share ``enough``.
    """
    if not problem.has_more_than_edges:
        return polish(problem.nearby(1.0), unit, start, enough)
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
    """Correct the residuals in two steps: from the coarse mesh to the meshes of ``problem``, then to finer meshes.

    A correction adds the difference between the residuals of two meshes at the optimum. ``coarse`` is the same fit on
    the coarse mesh of the search, and ``optimum`` its optimum. After each step the optimum is computed again. If a mesh
    has no equilibrium at the optimum, the results of the step before are returned.

    Returns
    -------
    tuple
        The corrected problem, its optimum, the change of the optimum by the second step (empty if it failed), and
        the largest stretch of the beam in any state, (1,), on the meshes of ``problem``.
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
    """Correct the residuals of a fit (problem) by a better beam model; return the corrected fit and its new optimum.

    ``better`` has the residuals of the better model at ``optimum``, the optimum of the problem ``now``. The difference
    of the residuals of both models is added to the residuals of the problem as a constant.
    """
    experiments = with_residuals_of(better, now.experiments, optimum.evaluation.comparison)
    return _with_change(replace(now, experiments=experiments), now, optimum)


def _with_solids(
    problem: Problem, optimum: Optimum[Evaluation]
) -> tuple[Problem, Optimum[Evaluation], tuple[Effect, ...]]:
    """Correct the residuals by three-dimensional models of solid sections and by finer meshes of the other sections.

    Returns
    -------
    tuple
        The corrected problem, its optimum, and the change of the optimum by each correction.
    """
    # The solid comes first. The optimum of the planar model alone compensates for the depth by a wrong law, and the
    # finer mesh may find no equilibrium for such a law.
    plain = problem.experiments
    problem, optimum, effects = _with_depth(problem, optimum)
    unit = optimum.unit
    mesh = _change(problem, FINER_MESH, plain, unit) if FINER_MESH in refinements(plain) else None
    if mesh is not None:
        problem, optimum = _with_change(replace(problem, experiments=mesh.added(problem.experiments)), problem, optimum)
        effects.append(Effect(mesh, optimum.unit - unit))
    return problem, optimum, tuple(effects)


def _with_depth(problem: Problem, optimum: Optimum[Evaluation]) -> tuple[Problem, Optimum[Evaluation], list[Effect]]:
    """Correct the residuals of the planar model by a three-dimensional beam model, in up to three passes.

    A pass adds the difference between the residuals of the two models to the residuals of the planar model, and
    computes the optimum again. The difference is computed at the optimum of the pass before. The passes end if the
    modulus has changed by less than 0.05 %. The second or third pass is rejected if it raises the objective by more
    than 1 %. The change of the modulus in the last pass counts as an error that remains.

    Returns
    -------
    tuple
        The corrected problem, its optimum, and a list with the change of the optimum by all passes. If the
        three-dimensional model finds no equilibrium, the problem is unchanged and the list is empty.
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
    """Compute the new optimum of a fit after its residuals were corrected by a better beam model.

    ``changed`` is the fit with the new correction, and is returned with the new optimum. ``now`` is the fit before,
    with its optimum, at which Gauss-Newton starts.
    """
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
    """Simulate one candidate alone, and return the comparison with the measurements of the experiments.

    A candidate is one set of values of the unknowns. The differences between two beam models are small. A simulation
    of several candidates together has other rounding errors, which would disturb these differences. ``unit`` has the n
    unit coordinates (0 to 1) of the candidate. If ``keep`` is true, the comparison keeps the full solution, so that a
    later call can start from its shapes (``near``).
    """
    return problem.evaluate(unit[None], 1.0, experiments, near, keep).comparison
