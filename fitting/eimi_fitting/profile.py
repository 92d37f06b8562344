"""Where the quadratic picture of the objective fails: the ends of an interval by the profile likelihood.

For one coordinate at a time the objective is minimised over all others (Raue et al. 2009, Bioinformatics 25:1923); an
interval ends where this minimum has risen as far as a quadratic would have at the ends that the covariance gives. The
others are found by Gauss-Newton steps with the Jacobian of the optimum, both ends of all coordinates in one batch.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Shares of the rise, which goes with the square of the half-width: a tenth of that is not worth a profile; an end is
# found where it is good to 1.5 % of it, and taken as found where it is good to 5 % when the rounds are over.
_AGREES, _THERE, _NEAR = 0.2, 0.03, 0.1
_MOST_ROUNDS = 8  # each a batch of candidates; an end that is not found by then is left too far out, not too near

# (P, n) -> rise of the objective (P,) above the optimum's, in the unit in which the curvature is one half of the second
# derivative, infinite where a candidate is not valid; and the gradient (P, n) of half of it.
Rise = Callable[[Array], tuple[Array, Array]]


@dataclass(frozen=True)
class Ends:
    """low, high: (n,) ends of the intervals; profiled: which coordinates needed the profile."""

    low: Array
    high: Array
    profiled: tuple[int, ...]


def interval_ends(
    rise: Rise, unit: Array, gradient: Array, curvature: Array, half_width: Array, looked_at: tuple[int, ...]
) -> Ends:
    """Ends of the intervals about the optimum ``unit`` (n,), which are half_width (n,) to a quadratic.

    gradient (n,) and curvature (n, n): of half the objective's rise at the optimum, where the gradient is zero but for
    coordinates that stand on a bound; looked_at: coordinates to check, the others keep the quadratic ends. All
    candidates stay within 0..1, and so do the ends that are found. An end that is not found is the quadratic's, or
    farther out.
    """
    low, high = unit - half_width, unit + half_width
    if not looked_at:
        return Ends(low, high, ())
    inverse = np.linalg.inv(curvature)
    which = np.repeat(np.array(looked_at), 2)
    target = half_width[which] ** 2 / inverse[which, which]
    offset = np.tile([-1.0, 1.0], len(looked_at)) * half_width[which]
    points = np.array([moved_to(unit, gradient, curvature, i, unit[i] + d) for i, d in zip(which, offset, strict=True)])
    values, gradients = rise(points)
    profiled = tuple(int(i) for i in np.unique(which[np.abs(values / target - 1) > _AGREES]))
    going = np.isin(which, profiled)
    if not profiled:
        return Ends(low, high, ())
    which, target, points, values, gradients = (a[going] for a in (which, target, points, values, gradients))
    rows = np.arange(len(which))
    below, above = np.zeros(len(which)), np.full(len(which), np.inf)  # offsets known to be inside and outside
    found = np.zeros(len(which), bool)
    for _ in range(_MOST_ROUNDS):
        for row, i in enumerate(which):  # a handful of rows: two a profiled coordinate
            if found[row]:
                continue
            offset_now = points[row, i] - unit[i]
            size, side = abs(offset_now), 1.0 if row % 2 else -1.0
            expected = np.inf
            if np.isfinite(values[row]):
                still = moved_to(points[row], gradients[row], curvature, i, points[row, i]) - points[row]
                expected = values[row] + 2 * float(gradients[row] @ still) + float(still @ curvature @ still)
            if values[row] <= target[row]:
                below[row] = max(below[row], size)
            elif expected > target[row]:
                above[row] = min(above[row], size)
            wanted = size * float(np.clip(np.sqrt(target[row] / max(expected, 1e-6 * target[row])), 0.4, 2.0))
            if not below[row] < wanted < above[row]:
                wanted = 0.5 * (below[row] + min(above[row], 2 * size))
            if np.isfinite(values[row]):
                points[row] = moved_to(points[row], gradients[row], curvature, i, unit[i] + side * wanted)
            else:
                points[row] = unit + (points[row] - unit) * (wanted / size)
        values, gradients = rise(points)
        ends = points[rows, which]
        found = (np.abs(values / target - 1) < _THERE) | (((ends <= 0) | (ends >= 1)) & (values <= target))
        if found.all():
            break
    for row, i in enumerate(which):
        end = points[row, i]
        near = bool(found[row]) or abs(values[row] / target[row] - 1) < _NEAR
        if row % 2:
            high[i] = end if near else max(high[i], end)
        else:
            low[i] = end if near else min(low[i], end)
    return Ends(low, high, profiled)


def moved_to(point: Array, gradient: Array, curvature: Array, i: int, to: float) -> Array:
    """The point with coordinate i moved, and all others put where a quadratic about it has its least within 0..1."""
    step = np.zeros(len(point))
    step[i] = np.clip(to, 0.0, 1.0) - point[i]
    free = np.arange(len(point)) != i
    for _ in range(len(point)):  # each time more coordinates are held on a bound
        if not free.any():
            break
        held = np.where(free, 0.0, step)
        slope = gradient + curvature @ held
        step = held
        step[free] = -np.linalg.solve(curvature[np.ix_(free, free)], slope[free])
        beyond = free & ((point + step < 0) | (point + step > 1))
        if not beyond.any():
            break
        step[beyond] = np.clip(point[beyond] + step[beyond], 0.0, 1.0) - point[beyond]
        free &= ~beyond
    return np.clip(point + step, 0.0, 1.0)
