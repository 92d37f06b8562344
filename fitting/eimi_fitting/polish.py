"""Gauss-Newton from the best candidate of a search, on a finer mesh than the search could afford.

The objective is a mean of root mean squares, the sum over k of sqrt(sum r_ki^2 / N_k). Its gradient is that of least
squares with the weights 1 / (N_k error_k), which are renewed at each step (iteratively reweighted least squares;
Holland and Welsch 1977, Commun. Statist. A 6:813). A step is taken only if it lowers the objective; directions that
the data do not fix are held where they are by a little damping.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from eimi_fitting.observation import Misfit

Array = NDArray[np.float64]

MOST_STEPS = 12
_SHORTER = np.array([0.3, 0.1])
# Of the objective, in mm: twenty independent points a state make the curvature over a twentieth of the mean error
# information, of which the bounds of the search hold 12 (a uniform distribution's). More would hold what the data fix.
_DAMPING = 12.0 / 20.0
_FACTORISED = 1e-12  # of the largest curvature: no less, or rounding makes it indefinite
_ENOUGH = 1e-4  # of the objective: a step that gains less is the last


class Compared(Protocol):
    """What a comparison of P candidates with the data says."""

    @property
    def objective_mm(self) -> Array:
        """(P,)."""

    @property
    def misfits(self) -> tuple[Misfit, ...]:
        """Residuals, one element an experiment."""


@dataclass(frozen=True)
class Polish:
    """Where the search ended and where Gauss-Newton led, both on the finer mesh: errors in mm, unit coordinates."""

    before_mm: float
    after_mm: float
    steps: int
    unit: Array


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


def polish(compare: Callable[[Array], Compared], unit: Array) -> Polish:
    """Improve ``unit`` (n,); ``compare`` takes (P, n) unit coordinates.

    Each step is tried at full length together with the differences about its end, which the next step needs: most
    steps are good, and a batch costs little more than one candidate. Only one that does not help is shortened.
    """
    batch, distance = difference_batch(unit)
    here = compare(batch)
    before = best = float(here.objective_mm[0])
    for steps in range(MOST_STEPS):
        step = _step(*_normal_equations(here.misfits, distance), unit, _DAMPING * best)
        reached = np.clip(unit + step, 0.0, 1.0)
        batch, distance = difference_batch(reached)
        here = compare(batch)
        if here.objective_mm[0] >= best:
            shorter = unit + step * _SHORTER[:, None]
            values = compare(shorter).objective_mm
            if values.min() >= best:
                return Polish(before, best, steps, unit)
            reached = shorter[np.argmin(values)]
            batch, distance = difference_batch(reached)
            here = compare(batch)
        unit, gained, best = reached, best - float(here.objective_mm[0]), float(here.objective_mm[0])
        if gained < _ENOUGH * best:
            return Polish(before, best, steps + 1, unit)
    return Polish(before, best, MOST_STEPS, unit)


def _step(gradient: Array, curvature: Array, unit: Array, damping: float) -> Array:
    """The step (n,) from ``unit`` to the quadratic's least value within the unit cube (Stark and Parker 1995, BVLS)."""
    damping = max(damping, _FACTORISED * float(np.trace(curvature)))
    factor = np.linalg.cholesky(curvature + damping * np.eye(len(unit)))
    found = optimize.lsq_linear(factor.T, -np.linalg.solve(factor, gradient), (-unit, 1.0 - unit), method="bvls")
    return np.asarray(found.x)


def _normal_equations(misfits: Sequence[Misfit], distance: Array) -> tuple[Array, Array]:
    """Gradient (n,) and curvature (n, n) of the objective, up to a factor."""
    n = len(distance)
    gradient, curvature = np.zeros(n), np.zeros((n, n))
    for misfit in misfits:
        r = misfit.residuals[0]
        slope = (misfit.residuals[1 : n + 1] - misfit.residuals[n + 1 :]) / distance[:, None, None, None]
        count = misfit.weights.sum(axis=(1, 2))
        weight = 1.0 / np.maximum(count * misfit.error_mm[0], 1e-12)
        gradient += np.einsum("ikgn,kgn,k->i", slope, r, weight)
        curvature += np.einsum("ikgn,jkgn,k->ij", slope, slope, weight)
    return gradient, curvature
