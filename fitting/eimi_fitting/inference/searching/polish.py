"""Improve the result of a global search by Gauss-Newton steps."""

# Load case k has N_k residuals r_ki in mm. The objective is proportional to
#
#     f = sum_k e_k,    e_k = sqrt(sum_i r_ki^2 / N_k).
#
# With the derivatives J_k of r_k by the unknowns and the weights w_k = 1 / (N_k e_k), its gradient and approximate
# Hessian are (iteratively reweighted least squares: Holland and Welsch 1977, Commun. Statist. A 6:813)
#
#     g = sum_k w_k J_k' r_k,    H = sum_k w_k J_k' J_k.
#
# Each step d minimises g' d + d' (H + lambda I) d / 2 within the bounds, with a small damping lambda.

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.evidence._quadratic import step_to_minimum
from eimi_fitting.inference.evidence.measurements import Misfit

Array = NDArray[np.float64]

MOST_STEPS = 12
_SHORTER = np.array([0.3, 0.1])  # lengths that are tried if the full step does not lower the objective
# Damping over the objective. The bounds of the search have the information 12 of a uniform distribution. With twenty
# independent points for each state, the information of the data is 20 H over the mean error. The damping 12 / 20 times
# the objective therefore corresponds to the bounds. More damping would hold directions that the data determine.
_DAMPING = 12.0 / 20.0
_FACTORISED = 1e-12  # smallest damping over the trace of H: with less, rounding makes the Hessian indefinite
ENOUGH = 1e-4  # the last step lowers the objective by less than this share


class Evaluation(Protocol):
    """The objective and the residuals of a fit for several candidate sets of parameters."""

    @property
    def objective_mm(self) -> Array:
        """The objective of each candidate."""

    @property
    def misfits(self) -> tuple[Misfit, ...]:
        """The residuals of each experiment, for all candidate sets of parameters."""


E = TypeVar("E", bound=Evaluation)


@dataclass(frozen=True)
class Polish:
    """The improvement of a fit by Gauss-Newton: the objective before and after it, and the number of accepted steps."""

    mean_error_before_mm: float
    mean_error_after_mm: float
    steps: int


@dataclass(frozen=True)
class Optimum(Generic[E]):
    """The optimum of a fit, with the residuals on both sides of it for central differences."""

    # (n,): the unknowns at the optimum, scaled to 0..1 between their bounds.
    unit: Array
    # The residuals at the 2 n + 1 points of `difference_batch`.
    evaluation: E
    # (n,): difference between the increased and the decreased value of each unknown.
    distance: Array
    # The improvement from the start to the optimum.
    polish: Polish


def difference_batch(unit: Array) -> tuple[Array, Array]:
    """Return a point with neighbours for central differences, and the distances of the neighbours."""
    # (2 n + 1, n): the point itself, then n points with one increased coordinate each, then n with one decreased
    # coordinate.
    n = len(unit)
    step = np.full(n, 1e-2)
    step[0] = 2e-4  # the logarithm of the modulus, over three decades
    ahead, behind = np.minimum(unit + step, 1.0), np.maximum(unit - step, 0.0)
    batch = np.tile(unit, (2 * n + 1, 1))
    batch[1 : n + 1][np.diag_indices(n)] = ahead
    batch[n + 1 :][np.diag_indices(n)] = behind
    return batch, ahead - behind


def polish(
    evaluate: Callable[[Array, E | None], E],
    unit: Array,
    start: tuple[E, Array] | None = None,
    enough: float = ENOUGH,
) -> Optimum[E]:
    """Minimise the objective of a fit by Gauss-Newton from a point near the optimum."""
    # evaluate: takes points (P, n), and an evaluation near them or None. unit (n,): the start, scaled to 0..1 between
    # the bounds. start: the residuals at the start and its neighbours, and the distances of the neighbours. enough: the
    # run ends when a step lowers the objective by a smaller share.
    here, distance = start or _about(evaluate, unit, None)
    before = best = float(here.objective_mm[0])
    for steps in range(1, MOST_STEPS + 1):
        step = _step(here, distance, unit, _DAMPING * best)
        # The end of the step is evaluated together with its neighbours: one batch costs little more than one candidate.
        reached = np.clip(unit + step, 0.0, 1.0)
        there, distance_there = _about(evaluate, reached, here)
        if there.objective_mm[0] >= best:
            shorter = unit + step * _SHORTER[:, None]
            values = evaluate(shorter, here).objective_mm
            if values.min() >= best:
                return Optimum(unit, here, distance, Polish(before, best, steps - 1))
            reached = shorter[np.argmin(values)]
            there, distance_there = _about(evaluate, reached, here)
        unit, here, distance = reached, there, distance_there
        gained, best = best - float(here.objective_mm[0]), float(here.objective_mm[0])
        if gained < enough * best:
            break
    return Optimum(unit, here, distance, Polish(before, best, steps))


def _about(evaluate: Callable[[Array, E | None], E], unit: Array, near: E | None) -> tuple[E, Array]:
    batch, distance = difference_batch(unit)
    return evaluate(batch, near), distance


def _step(here: Evaluation, distance: Array, unit: Array, damping: float) -> Array:
    # A damped Gauss-Newton step, (n,).
    gradient, hessian = _normal_equations(here.misfits, distance)
    # The end of the step has coordinates from 0 to 1.
    damping = max(damping, _FACTORISED * float(np.trace(hessian)))
    return step_to_minimum(unit, gradient, hessian + damping * np.eye(len(unit)))


def _normal_equations(misfits: Sequence[Misfit], distance: Array) -> tuple[Array, Array]:
    # Gradient and approximate Hessian, from finite differences of the residuals.
    n = len(distance)
    gradient, hessian = np.zeros(n), np.zeros((n, n))
    for misfit in misfits:
        r = misfit.residuals[0]
        slope = (misfit.residuals[1 : n + 1] - misfit.residuals[n + 1 :]) / distance[:, None, None, None]
        count = misfit.weights.sum(axis=(1, 2))
        weight = 1.0 / np.maximum(count * misfit.error_mm[0], 1e-12)
        gradient += np.einsum("ikgn,kgn,k->i", slope, r, weight)
        hessian += np.einsum("ikgn,jkgn,k->ij", slope, slope, weight)
    return gradient, hessian
