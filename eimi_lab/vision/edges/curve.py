"""A smooth curve through points of an edge, walked by arc length."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_lsq_spline

Array = NDArray[np.float64]

_FEWEST = 3  # points in a piece of a given length


class SmoothCurve:
    """Least-squares cubic spline through ordered points (n, 2), n >= 4.

    pieces: number of spline intervals; fewer than n - 3, or it is reduced. equal: whether they are equally long, and
    do not hold equally many points; where one would hold fewer than three, it is part of the one before. length: arc
    length from the first to the last point, in the points' unit.
    """

    def __init__(self, points: Array, pieces: int, equal: bool = False) -> None:
        step = np.hypot(*np.diff(points, axis=0).T)
        parameter = np.concatenate([[0.0], np.cumsum(np.maximum(step, 1e-9))])
        pieces = max(1, min(pieces, (len(points) - 3) // 2))
        # Each interval has to hold points, which the least squares needs: at quantiles of the data it does.
        share = np.linspace(0.0, 1.0, pieces + 1)
        knots = _with_points(parameter[-1] * share, parameter) if equal else np.quantile(parameter, share)
        self.pieces = pieces = len(knots) - 1
        knots = np.concatenate([np.repeat(knots[0], 3), knots, np.repeat(knots[-1], 3)])
        self._spline: BSpline = make_lsq_spline(parameter, points, knots, k=3)
        self._slope: BSpline = self._spline.derivative()
        self._parameter = np.linspace(parameter[0], parameter[-1], 8 * pieces + 33)
        dense = self._spline(self._parameter)
        self._distance = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(dense, axis=0).T))])
        self.length = float(self._distance[-1])

    def at(self, distance: Array) -> tuple[Array, Array]:
        """Points and unit tangents at arc lengths; both have the shape of ``distance`` with (2,) added.

        Beyond 0..length the curve goes on straight.
        """
        parameter = np.interp(distance, self._distance, self._parameter)
        tangent = self._slope(parameter)
        tangent /= np.maximum(np.linalg.norm(tangent, axis=-1, keepdims=True), 1e-12)
        beyond = distance - np.clip(distance, 0.0, self.length)
        return self._spline(parameter) + beyond[..., None] * tangent, tangent

    def curvature(self, distance: Array) -> Array:
        """Second derivative (n, 2) of the place with respect to arc length: toward the centre, one over the radius."""
        parameter = np.interp(distance, self._distance, self._parameter)
        slope, second = self._slope(parameter), self._slope.derivative()(parameter)
        speed = np.maximum((slope**2).sum(axis=-1, keepdims=True), 1e-12)
        along = (second * slope).sum(axis=-1, keepdims=True) / speed
        return np.asarray((second - along * slope) / speed)


def _with_points(knots: Array, parameter: Array) -> Array:
    """The knots without those before which, or behind the last of which, lie too few of the sorted parameters."""
    before = np.searchsorted(parameter, knots)
    kept = [0]
    for knot in range(1, len(knots) - 1):
        if min(before[knot] - before[kept[-1]], len(parameter) - before[knot]) >= _FEWEST:
            kept.append(knot)
    return knots[[*kept, -1]]
