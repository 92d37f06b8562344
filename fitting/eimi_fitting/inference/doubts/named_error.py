"""Separate the residuals that a named cause explains from the noise, and compute the intervals of a fit again.

A cause is an error of the bench that no file states, such as a rolled camera. Its residuals are similar in all points
and states. If they counted as correlated noise, the data would have only one or two independent points, and an interval
could be hundreds of per cent wide. If they counted as noise of independent points, the interval would be narrower than
the error of the modulus that the cause produces.

If causes are probable and explain most of the residuals, the noise is therefore computed from the residuals that remain
with the most probable causes. The change of the modulus by these causes widens the interval: it counts as the 95 %
bound of a further normal error. The value of the modulus stays the value of the fit without the causes.
"""

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
# What describes the residuals of the fit itself, which the comparison of laws uses.
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
    """Return the estimate of a fit with new intervals, in which residuals of the probable causes are not noise.

    A cause is a possible error of the bench, such as a tilted camera. Its residuals are similar in many points. If they
    counted as noise, the intervals would be far too wide or too narrow.

    Parameters
    ----------
    problem, optimum, effects, refinements, seed
        See `inference.interval.estimate.estimate`.
    weighed : Weighed
        The possible causes of the residuals.
    before : Estimate
        The estimate that counts all residuals as noise.

    Returns
    -------
    Estimate or None
        The estimate, or None if ``before`` stays valid. This is so if the fit has taken all probable causes into
        account, if the causes explain less than half of the mean error (`remaining_error_mm`), or if one of the most
        probable causes is a choice of the user: the law, or a planar model of a solid section.
    """
    remaining = weighed.remaining
    if remaining is None or weighed.beside_the_fit < _PROBABLE or _OF_THE_MODEL & weighed.most_probable:
        return None
    error_mm = remaining_error_mm(weighed, problem.experiments)
    if error_mm is None or error_mm > _EXPLAINS * optimum.evaluation.comparison.error_mm[0].mean():
        return None
    misfits = optimum.evaluation.comparison.misfits
    changes = [after - misfit.residuals[0] for after, misfit in zip(remaining, misfits, strict=True)]
    changed, reached = _with_changes(problem, optimum, changes)
    about = linearise(changed, reached)
    # Without the residuals of the causes, the optimum would move by `step`. The effect of this step on the residuals is
    # added, so that the optimum stays the optimum of the fit to first order.
    step = -np.linalg.solve(about.hessian, about.score)
    held = [np.tensordot(step, states.slopes, axes=1) for states in about.states]
    changed, reached = _with_changes(
        problem, optimum, [change + more for change, more in zip(changes, held, strict=True)]
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
    """Return the mean error in mm that would remain if a fit took the most probable causes into account.

    A cause is a possible error of the bench. The mean error is the mean over the states of the root mean square
    residual. None if it is not known.
    """
    if weighed.remaining is None:
        return None
    errors = [
        experiment.observed.of_residuals(residuals[None]).error_mm
        for experiment, residuals in zip(experiments, weighed.remaining, strict=True)
    ]
    return float(np.concatenate(errors, axis=1).mean())


def contains(modulus: Quantity, shifts_percent: Iterable[float]) -> bool:
    """Return whether the 95 % interval of the modulus is wide enough for each of several changes of the modulus in %.

    It is wide enough if the modulus after the change still lies in the interval.
    """
    low, high = modulus.interval_95
    return all(low <= modulus.value * (1 + 1e-2 * shift) <= high for shift in shifts_percent)


def _with_changes(
    problem: Problem, optimum: Optimum[Evaluation], changes: Sequence[Array]
) -> tuple[Problem, Optimum[Evaluation]]:
    """Add changes to the residuals of a problem and of its optimum, and return both.

    ``changes`` has the changes in mm for each experiment, with the shape (K, G, m) for G groups (edges, or x and y) of
    m points in K states.
    """
    experiments = tuple(
        replace(e, change=change if e.change is None else e.change + change)
        for e, change in zip(problem.experiments, changes, strict=True)
    )
    changed = replace(problem, experiments=experiments)
    return changed, replace(optimum, evaluation=changed.with_own_changes(optimum.evaluation, problem))
