"""Gauss-Newton from the best candidate of a search.

The objective is a mean of root mean squares, the sum over k of sqrt(sum r_ki^2 / N_k). Its gradient is that of least
squares with the weights 1 / (N_k error_k), which are renewed at each step (iteratively reweighted least squares;
Holland and Welsch 1977, Commun. Statist. A 6:813). A step is taken only if it lowers the objective; directions that
the data do not fix are held where they are by a little damping.
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
_SHORTER = np.array([0.3, 0.1])
# Of the objective, in mm: twenty independent points a state make the Hessian over a twentieth of the mean error
# information, of which the bounds of the search hold 12 (a uniform distribution's). More would hold what the data fix.
_DAMPING = 12.0 / 20.0
_FACTORISED = 1e-12  # of the largest hessian: no less, or rounding makes it indefinite
ENOUGH = 1e-4  # of the objective


class Evaluation(Protocol):
    """What a problem says of P candidates."""

    @property
    def objective_mm(self) -> Array:
        """(P,)."""

    @property
    def misfits(self) -> tuple[Misfit, ...]:
        """Residuals, one element an experiment."""


E = TypeVar("E", bound=Evaluation)


@dataclass(frozen=True)
class Polish:
    """Errors in mm where the search ended and where Gauss-Newton led, both on one mesh, and its steps.

    With tensile curves or freed nuisances in the fit they are the objective's, which holds them too.
    """

    mean_error_before_mm: float
    mean_error_after_mm: float
    steps: int


@dataclass(frozen=True)
class Optimum(Generic[E]):
    """Where a polish ended: unit (n,), and the evaluation of `difference_batch` there with its distance (n,)."""

    unit: Array
    evaluation: E
    distance: Array
    polish: Polish


def difference_batch(unit: Array) -> tuple[Array, Array]:
    """(2 n + 1, n) candidates at and about ``unit`` and the (n,) distances between the two of each coordinate."""
    n = len(unit)
    step = np.full(n, 1e-2)
    step[0] = 2e-4  # the modulus: a range of three decades
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
    """Improve ``unit`` (n,); ``evaluate`` takes (P, n) unit coordinates, and what it said of others near them, or None.

    start: the evaluation of `difference_batch` at ``unit`` with its distances, where it is known; enough: a step that
    gains less of the objective is the last.
    Each step is tried at full length together with the differences about its end, which the next step needs: most
    steps are good, and a batch costs little more than one candidate. Only one that does not help is shortened.
    """
    here, distance = start or _about(evaluate, unit, None)
    before = best = float(here.objective_mm[0])
    for steps in range(1, MOST_STEPS + 1):
        step = _step(here, distance, unit, _DAMPING * best)
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
    """The step (n,) from ``unit`` to the least value of the objective's quadratic within the unit cube."""
    gradient, hessian = _normal_equations(here.misfits, distance)
    damping = max(damping, _FACTORISED * float(np.trace(hessian)))
    return step_to_minimum(unit, gradient, hessian + damping * np.eye(len(unit)))


def _normal_equations(misfits: Sequence[Misfit], distance: Array) -> tuple[Array, Array]:
    """Gradient (n,) and Hessian (n, n) of the objective, up to a factor."""
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
