"""Where the quadratic picture of the objective fails: the ends of an interval by the profile likelihood.

For one coordinate at a time the deviance is minimised over all others (Raue et al. 2009, Bioinformatics 25:1923); an
interval ends where this minimum has risen as far as a quadratic would have at the ends that the covariance gives. The
others are found by Gauss-Newton steps with the Hessian of the optimum, both ends of all coordinates in one batch.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.evidence._quadratic import step_to_minimum

Array = NDArray[np.float64]

# Shares of the deviance, which goes with the square of the half-width: a tenth of that is not worth a profile; an end
# is found where it is good to 1.5 % of it, and taken as found where it is good to 5 % when the rounds are over.
_AGREES, _THERE, _NEAR = 0.2, 0.03, 0.1
_MOST_ROUNDS = 8  # each a batch of candidates; an end that is not found by then is left too far out, not too near
_SHORTEST, _LONGEST = 0.4, 2.0  # of the offset so far, that the next one may be: within these a quadratic is trusted

# (P, n) -> deviance (P,): how far -2 log L lies above the optimum's, infinite where a candidate is not valid; and the
# score (P, n), the gradient of half of it.
Deviance = Callable[[Array], tuple[Array, Array]]


@dataclass(frozen=True)
class Ends:
    """low, high: (n,) ends of the intervals; profiled: which coordinates needed the profile."""

    low: Array
    high: Array
    profiled: tuple[int, ...]


@dataclass
class _End:
    """One end of one coordinate's interval while it is sought.

    side: -1 below, 1 above; target: the deviance there; point (n,) with its deviance and score (n,); inside, outside:
    offsets from the optimum known to lie within the interval and beyond it.
    """

    coordinate: int
    side: int
    target: float
    point: Array
    deviance: float = np.inf
    score: Array | None = None
    inside: float = 0.0
    outside: float = np.inf

    @property
    def off(self) -> float:
        """Share of the target by which the deviance misses it."""
        return abs(self.deviance / self.target - 1)

    @property
    def is_found(self) -> bool:
        """Whether it is there, or held by a bound."""
        on_bound = not 0 < self.point[self.coordinate] < 1
        return self.off < _THERE or (on_bound and self.deviance <= self.target)

    def advance(self, unit: Array, hessian: Array) -> None:
        """Move the point to where the deviance should be the target, the others at their best."""
        i = self.coordinate
        size = abs(self.point[i] - unit[i])
        expected = np.inf
        if np.isfinite(self.deviance) and self.score is not None:
            still = moved_to(self.point, self.score, hessian, i, self.point[i]) - self.point
            expected = self.deviance + 2 * float(self.score @ still) + float(still @ hessian @ still)
        if self.deviance <= self.target:
            self.inside = max(self.inside, size)
        elif expected > self.target:
            self.outside = min(self.outside, size)
        share = np.sqrt(self.target / max(expected, 1e-6 * self.target))
        wanted = size * float(np.clip(share, _SHORTEST, _LONGEST))
        if not self.inside < wanted < self.outside:
            wanted = 0.5 * (self.inside + min(self.outside, 2 * size))
        if np.isfinite(self.deviance) and self.score is not None:
            self.point = moved_to(self.point, self.score, hessian, i, unit[i] + self.side * wanted)
        else:
            self.point = unit + (self.point - unit) * (wanted / size)


def interval_ends(
    deviance: Deviance, unit: Array, score: Array, hessian: Array, half_width: Array, looked_at: tuple[int, ...]
) -> Ends:
    """Ends of the intervals about the optimum ``unit`` (n,), which are half_width (n,) to a quadratic.

    score (n,) and hessian (n, n): of half the deviance at the optimum, where the score is zero but for coordinates
    that stand on a bound; looked_at: coordinates to check, the others keep the quadratic ends. All candidates stay
    within 0..1, and so do the ends that are found. An end that is not found is the quadratic's, or farther out.
    """
    low, high = unit - half_width, unit + half_width
    if not looked_at:
        return Ends(low, high, ())
    inverse = np.linalg.inv(hessian)
    ends = [
        _End(i, side, half_width[i] ** 2 / inverse[i, i], moved_to(unit, score, hessian, i, unit[i] + side * half))
        for i, half in ((i, half_width[i]) for i in looked_at)
        for side in (-1, 1)
    ]
    _evaluate(deviance, ends)
    profiled = tuple(sorted({end.coordinate for end in ends if end.off > _AGREES}))
    ends = going = [end for end in ends if end.coordinate in profiled]
    for _ in range(_MOST_ROUNDS):
        if not going:
            break
        for end in going:
            end.advance(unit, hessian)
        _evaluate(deviance, going)
        going = [end for end in going if not end.is_found]
    for end in ends:
        i, at = end.coordinate, end.point[end.coordinate]
        near = end.is_found or end.off < _NEAR
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
    """The point with coordinate i moved, and all others put where a quadratic about it has its least within 0..1."""
    step = np.zeros(len(point))
    step[i] = np.clip(to, 0.0, 1.0) - point[i]
    free = np.arange(len(point)) != i
    if free.any():
        slope = score[free] + hessian[free, i] * step[i]
        step[free] = step_to_minimum(point[free], slope, hessian[np.ix_(free, free)])
    return np.clip(point + step, 0.0, 1.0)
