"""Compute the ends of asymmetric intervals by the profile likelihood."""

# The deviance D(x) of the unknowns x is twice the decrease of the log-likelihood from its maximum. The profile of
# unknown i is
#
#     D_i(t) = min of D(x) over all x with x_i = t
#
# (Raue et al. 2009, Bioinformatics 25:1923). Let H be the Hessian matrix of D / 2, and h the half-width of the interval
# that the covariance of the unknowns gives. The interval ends where D_i = h^2 / inv(H)_ii.

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.evidence._quadratic import step_to_minimum

Array = NDArray[np.float64]

# Relative differences of the deviance from its target. The deviance grows with the square of the half-width, so that
# the relative difference of the half-width is half as large. Up to _AGREES, the end that the covariance gives is used.
# The iteration of an end stops if the difference is below _CONVERGED. After the last round, an end with a difference
# below _NEAR is accepted.
_AGREES, _CONVERGED, _NEAR = 0.2, 0.03, 0.1
# Largest number of rounds, each with one batch of candidates. Without convergence, the result is the last estimate
# or the end that the covariance gives, whichever is farther from the optimum.
_MOST_ROUNDS = 8
_SHORTEST, _LONGEST = 0.4, 2.0  # limits of the next offset over the present one

# Takes candidates (P, n). Returns their deviances (P,), infinite for a candidate that is not valid, and their scores
# (P, n), the gradient of half the deviance.
Deviance = Callable[[Array], tuple[Array, Array]]


@dataclass(frozen=True)
class Ends:
    """The ends of the 95 % intervals of the unknowns of a fit."""

    # (n,): scaled to 0..1 between the bounds of the unknowns.
    low: Array
    high: Array
    # Indices of the unknowns with ends from the profile likelihood.
    profiled: tuple[int, ...]


@dataclass
class _End:
    # One end of the interval of one unknown, during its iterative computation.

    # Index of the unknown.
    coordinate: int
    # -1 for the lower end, 1 for the upper end.
    side: int
    # The deviance that the end must have.
    target: float
    # (n,): estimate of the unknowns at the end, scaled to 0..1 between their bounds.
    point: Array
    # The deviance at `point`, and the gradient (n,) of half the deviance.
    deviance: float = np.inf
    score: Array | None = None
    # Largest tried distance from the optimum inside the interval, and smallest tried distance outside.
    inside: float = 0.0
    outside: float = np.inf

    @property
    def off(self) -> float:
        return abs(self.deviance / self.target - 1)

    @property
    def has_converged(self) -> bool:
        # At a bound of the search, the deviance may be smaller than its target.
        on_bound = not 0 < self.point[self.coordinate] < 1
        return self.off < _CONVERGED or (on_bound and self.deviance <= self.target)

    def advance(self, unit: Array, hessian: Array) -> None:
        # Move the estimate to where the deviance should equal the target.
        i = self.coordinate
        # ``hessian`` is the Hessian of half the deviance at the optimum.
        size = abs(self.point[i] - unit[i])
        expected = np.inf
        if np.isfinite(self.deviance) and self.score is not None:
            step = moved_to(self.point, self.score, hessian, i, self.point[i]) - self.point
            expected = self.deviance + 2 * float(self.score @ step) + float(step @ hessian @ step)
        if self.deviance <= self.target:
            self.inside = max(self.inside, size)
        elif expected > self.target:
            self.outside = min(self.outside, size)
        # The smallest deviance for a given coordinate grows about as the square of its distance from the optimum.
        share = np.sqrt(self.target / max(expected, 1e-6 * self.target))
        next_size = size * float(np.clip(share, _SHORTEST, _LONGEST))
        if not self.inside < next_size < self.outside:
            next_size = 0.5 * (self.inside + min(self.outside, 2 * size))
        if np.isfinite(self.deviance) and self.score is not None:
            self.point = moved_to(self.point, self.score, hessian, i, unit[i] + self.side * next_size)
        else:
            self.point = unit + (self.point - unit) * (next_size / size)


def interval_ends(
    deviance: Deviance, unit: Array, score: Array, hessian: Array, half_width: Array, checked: tuple[int, ...]
) -> Ends:
    """Return the ends of the intervals of the unknowns, which may be asymmetric."""
    # There are n unknowns, scaled to 0..1 between their bounds. score (n,), hessian (n, n): of half the deviance at the
    # optimum `unit`. half_width (n,): for a quadratic deviance. checked: indices of the unknowns whose intervals may be
    # asymmetric.
    low, high = unit - half_width, unit + half_width
    if not checked:
        return Ends(low, high, ())
    inverse = np.linalg.inv(hessian)
    ends = [
        _End(i, side, half_width[i] ** 2 / inverse[i, i], moved_to(unit, score, hessian, i, unit[i] + side * half))
        for i, half in ((i, half_width[i]) for i in checked)
        for side in (-1, 1)
    ]
    _evaluate(deviance, ends)
    profiled = tuple(sorted({end.coordinate for end in ends if end.off > _AGREES}))
    ends = unfinished = [end for end in ends if end.coordinate in profiled]
    for _ in range(_MOST_ROUNDS):
        if not unfinished:
            break
        for end in unfinished:
            end.advance(unit, hessian)
        _evaluate(deviance, unfinished)
        unfinished = [end for end in unfinished if not end.has_converged]
    for end in ends:
        i, at = end.coordinate, end.point[end.coordinate]
        # Without convergence, the end is the last estimate or the quadratic end, whichever is farther from the optimum.
        near = end.has_converged or end.off < _NEAR
        if end.side > 0:
            high[i] = at if near else max(high[i], at)
        else:
            low[i] = at if near else min(low[i], at)
    return Ends(low, high, profiled)


def _evaluate(deviance: Deviance, ends: Sequence[_End]) -> None:
    values, scores = deviance(np.array([end.point for end in ends]))
    for end, value, score in zip(ends, values, scores, strict=True):
        end.deviance, end.score = float(value), score


def moved_to(point: Array, score: Array, hessian: Array, i: int, to: float) -> Array:
    """Minimise a quadratic function in the unit cube, with one coordinate fixed."""
    # `score` and `hessian` are those of the function at `point`. Coordinate `i` has the value `to`.
    step = np.zeros(len(point))
    step[i] = np.clip(to, 0.0, 1.0) - point[i]
    free = np.arange(len(point)) != i
    if free.any():
        slope = score[free] + hessian[free, i] * step[i]
        step[free] = step_to_minimum(point[free], slope, hessian[np.ix_(free, free)])
    return np.clip(point + step, 0.0, 1.0)
