"""Improve the result of a global search by Gauss-Newton (iteratively reweighted least squares).

Load state k has N_k residuals r_ki in mm, which form the vector r_k. Up to a constant factor, the objective is

    f = sum_k e_k,    e_k = sqrt(sum_i r_ki^2 / N_k)

The matrices J_k = dr_k/dx are derivatives by the unknowns x, which are scaled so that their bounds are 0 and 1. The
gradient g of f equals the gradient of a least-squares sum with the weights w_k = 1 / (N_k e_k), whose approximate
Hessian is H:

    g = sum_k w_k J_k' r_k,    H = sum_k w_k J_k' J_k

(Holland and Welsch 1977, Commun. Statist. A 6:813). Each step d minimises g' d + d' (H + lambda I) d / 2 within the
bounds. The weights are computed again at each step. The small damping lambda prevents steps in directions that the data
do not determine. A step is accepted only if it lowers the objective.
"""

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
    """The objective and the residuals of a fit for P sets of values of the unknowns."""

    @property
    def objective_mm(self) -> Array:
        """The objective of the fit for each of P sets of values of the unknowns, (P,) in mm."""

    @property
    def misfits(self) -> tuple[Misfit, ...]:
        """The residuals for P sets of values of the unknowns, one element for each experiment."""


E = TypeVar("E", bound=Evaluation)


@dataclass(frozen=True)
class Polish:
    """The improvement of a fit by Gauss-Newton: number of steps, and objective before and after them.

    Parameters
    ----------
    mean_error_before_mm, mean_error_after_mm : float
        Objective before and after the steps in mm.
    steps : int
        Number of accepted Gauss-Newton steps.
    """

    mean_error_before_mm: float
    mean_error_after_mm: float
    steps: int


@dataclass(frozen=True)
class Optimum(Generic[E]):
    """The optimum of a fit, with evaluations on both sides of it for central differences.

    Parameters
    ----------
    unit : ndarray, shape (n,)
        Values of the n unknowns at the optimum, from 0 to 1 between their bounds.
    evaluation : Evaluation
        The residuals at 2 n + 1 points: the optimum, then n points with one value increased, then n points with one
        value decreased.
    distance : ndarray, shape (n,)
        Difference between the increased and the decreased value of each unknown.
    polish : Polish
        The improvement from the start to the optimum.
    """

    unit: Array
    evaluation: E
    distance: Array
    polish: Polish


def difference_batch(unit: Array) -> tuple[Array, Array]:
    """Return the points at which a function is computed for its derivatives by central differences at a point.

    Parameters
    ----------
    unit : ndarray, shape (n,)
        The point at which the derivatives are needed, with n coordinates from 0 to 1.

    Returns
    -------
    batch : ndarray, shape (2 n + 1, n)
        One point in each row: ``unit``, then n points with one coordinate increased, then n points with one coordinate
        decreased. All coordinates are from 0 to 1.
    distance : ndarray, shape (n,)
        Difference between the increased and the decreased value of each coordinate.
    """
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
    """Minimise the objective of a fit by Gauss-Newton from a point near the optimum.

    Parameters
    ----------
    evaluate : callable
        Takes the n coordinates of P points, (P, n), and an earlier evaluation near these points or None. Returns the
        objective and the residuals at the P points.
    unit : ndarray, shape (n,)
        The start: values of the n unknowns from 0 to 1 between their bounds.
    start : (Evaluation, ndarray), optional
        The residuals at the start and at its neighbours for central differences, and the distance between the two
        neighbours in each coordinate, (n,). Computed by default.
    enough : float
        The run ends when a step lowers the objective by less than this fraction.

    Returns
    -------
    Optimum
        The optimum after at most `MOST_STEPS` steps.
    """
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
    """Return a damped Gauss-Newton step, (n,), from the point ``unit``; its end has coordinates from 0 to 1."""
    gradient, hessian = _normal_equations(here.misfits, distance)
    damping = max(damping, _FACTORISED * float(np.trace(hessian)))
    return step_to_minimum(unit, gradient, hessian + damping * np.eye(len(unit)))


def _normal_equations(misfits: Sequence[Misfit], distance: Array) -> tuple[Array, Array]:
    """Return the gradient (n,) and the approximate Hessian (n, n) of the objective of a fit in the n unknowns."""
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
