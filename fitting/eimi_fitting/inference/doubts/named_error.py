"""Compute intervals of a fit that allow for the probable systematic errors, such as a wrong scale."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.doubts.causes import Weighed
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.objective import Evaluation, Problem
from eimi_fitting.inference.evidence.quantity import Quantity
from eimi_fitting.inference.interval.covariance import linearise
from eimi_fitting.inference.interval.estimate import Estimate, estimate
from eimi_fitting.inference.interval.noise import Effect, linearise_noise
from eimi_fitting.inference.searching.polish import Optimum

Array = NDArray[np.float64]

_OF_THE_MODEL = frozenset({"section", "law"})  # the user chooses these, and the interval is that of the choice
_PROBABLE = 0.95
_ENLARGED = 1.1  # factor on the change of the modulus, so that the interval surely contains it
_EXPLAINS = 0.5  # share of the mean error that remains at most
# The fields that describe the residuals of the fit itself. The comparison of laws uses these fields.
_OF_RESIDUALS = (
    *("residual_mm", "correlation_points", "points", "independent_points", "noise_mm", "noise_points"),
    "stated_squares",
)


def estimate_beside(
    problem: Problem,
    optimum: Optimum[Evaluation],
    effects: Sequence[Effect],
    weighed: Weighed,
    before: Estimate,
    refinements: Sequence[str],
    seed: int,
) -> Estimate | None:
    """Compute intervals of a fit that allow for the probable systematic errors, or return None if there are none."""
    # The noise is computed from the residuals after a correction for the errors. The change of the modulus by the
    # correction widens the interval. The result is also None if the errors explain too little of the residuals.
    remaining = weighed.remaining
    if remaining is None or weighed.beside_the_fit < _PROBABLE or _OF_THE_MODEL & weighed.most_probable:
        return None
    error_mm = remaining_error_mm(weighed, problem.experiments)
    if error_mm is None or error_mm > _EXPLAINS * optimum.evaluation.comparison.error_mm[0].mean():
        return None
    # The residuals of a cause are alike in all points. As correlated noise, they would leave one or two independent
    # points and an interval of hundreds of per cent. As noise of independent points, they would give an interval
    # narrower than the error of the modulus. The value of the modulus stays that of the fit.
    misfits = optimum.evaluation.comparison.misfits
    changes = [after - misfit.residuals[0] for after, misfit in zip(remaining, misfits, strict=True)]
    changed, reached = _with_changes(problem, optimum, changes)
    about = linearise(changed, reached)
    # Without the residuals of the causes, the optimum would move by `step`. The effect of this step on the residuals is
    # added, so that the optimum stays the optimum of the fit to first order.
    step = -np.linalg.solve(about.hessian, about.score)
    by_step = [np.tensordot(step, states.slopes, axes=1) for states in about.states]
    changed, reached = _with_changes(
        problem, optimum, [change + more for change, more in zip(changes, by_step, strict=True)]
    )
    noise = linearise_noise(changed, reached, effects)
    shift = _ENLARGED * max(weighed.modulus_percent, key=abs)
    result = estimate(changed, reached, effects, noise, refinements, seed, shift)
    of_residuals = {name: getattr(before.identifiability, name) for name in _OF_RESIDUALS}
    return replace(
        result,
        identifiability=replace(result.identifiability, **of_residuals),
        mesh=before.mesh,
        section_change=before.section_change,
        held_out_error_mm=before.held_out_error_mm,
    )


def remaining_error_mm(weighed: Weighed, experiments: Sequence[Experiment]) -> float | None:
    """Return the mean residual (mm) of a fit after a correction for the most probable systematic errors."""
    if weighed.remaining is None:
        return None
    errors = [
        experiment.observed.of_residuals(residuals[None]).error_mm
        for experiment, residuals in zip(experiments, weighed.remaining, strict=True)
    ]
    return float(np.concatenate(errors, axis=1).mean())


def contains(modulus: Quantity, shifts_percent: Iterable[float]) -> bool:
    """Return whether the modulus, changed by each of these percentages, stays inside its 95 % interval."""
    low, high = modulus.interval_95
    return all(low <= modulus.value * (1 + 1e-2 * shift) <= high for shift in shifts_percent)


def _with_changes(
    problem: Problem, optimum: Optimum[Evaluation], changes: Sequence[Array]
) -> tuple[Problem, Optimum[Evaluation]]:
    # Adds changes in mm to the residuals of each experiment.
    experiments = tuple(
        replace(e, change=change if e.change is None else e.change + change)
        for e, change in zip(problem.experiments, changes, strict=True)
    )
    changed = replace(problem, experiments=experiments)
    return changed, replace(optimum, evaluation=changed.recorrected(optimum.evaluation, problem))
