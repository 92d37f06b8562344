"""Fit a smooth curve through the points of an edge of the beam."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

_FEWEST = 3  # points in an interval of given length


class SmoothCurve:
    """Least-squares cubic spline through ordered points in the plane, with the arc length as parameter.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        At least four points in their order along the curve.
    pieces : int
        Desired number of intervals of the spline; fewer if there are too few points.
    equal : bool
        True for intervals of equal length, False for intervals with equally many points.

    Attributes
    ----------
    length : float
        Arc length from the first to the last point, in the unit of the points.
    pieces : int
        Number of intervals of the spline.

    Examples
    --------
    >>> angle = np.linspace(0.0, np.pi, 50)
    >>> half_circle = SmoothCurve(2.0 * np.column_stack([np.cos(angle), np.sin(angle)]), pieces=6)
    >>> round(half_circle.length / np.pi, 3)
    2.0
    >>> place, tangent = half_circle.at(np.array([0.5 * half_circle.length]))
    >>> bool(np.allclose(place, [[0.0, 2.0]], atol=0.01))
    True
    """

    def __init__(self, points: Array, pieces: int, equal: bool = False) -> None:
        step = np.hypot(*np.diff(points, axis=0).T)
        parameter = np.concatenate([[0.0], np.cumsum(np.maximum(step, 1e-9))])
        pieces = max(1, min(pieces, (len(points) - 3) // 2))
        # The least squares need points in every interval; knots at quantiles of the data ensure this.
        share = np.linspace(0.0, 1.0, pieces + 1)
        knots = _with_points(parameter[-1] * share, parameter) if equal else np.quantile(parameter, share)
        self.pieces = pieces = len(knots) - 1
        knots = np.concatenate([np.repeat(knots[0], 3), knots, np.repeat(knots[-1], 3)])
        self._spline: scipy.interpolate.BSpline = scipy.interpolate.make_lsq_spline(parameter, points, knots, k=3)
        self._slope: scipy.interpolate.BSpline = self._spline.derivative()
        self._parameter = np.linspace(parameter[0], parameter[-1], 8 * pieces + 33)
        dense = self._spline(self._parameter)
        self._distance = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(dense, axis=0).T))])
        self.length = float(self._distance[-1])

    def at(self, distance: Array) -> tuple[Array, Array]:
        """Return points and unit tangents of the curve at given arc lengths.

        Beyond its ends the curve continues as a straight line.

        Parameters
        ----------
        distance : ndarray, shape (...)
            Arc lengths from the first point.

        Returns
        -------
        points, tangents : ndarray, shape (..., 2)
            Points of the curve, and unit tangents.
        """
        parameter = np.interp(distance, self._distance, self._parameter)
        tangent = self._slope(parameter)
        tangent /= np.maximum(np.linalg.norm(tangent, axis=-1, keepdims=True), 1e-12)
        beyond = distance - np.clip(distance, 0.0, self.length)
        return self._spline(parameter) + beyond[..., None] * tangent, tangent

    def curvature(self, distance: Array) -> Array:
        """Return the curvature vectors (toward the centre of curvature, length 1/radius) at given arc lengths."""
        parameter = np.interp(distance, self._distance, self._parameter)
        slope, second = self._slope(parameter), self._slope.derivative()(parameter)
        speed = np.maximum((slope**2).sum(axis=-1, keepdims=True), 1e-12)
        along = (second * slope).sum(axis=-1, keepdims=True) / speed
        return np.asarray((second - along * slope) / speed)


def _with_points(knots: Array, parameter: Array) -> Array:
    """Return the knots of a spline, thinned so that at least three points lie between neighbours."""
    before = np.searchsorted(parameter, knots)
    kept = [0]
    for knot in range(1, len(knots) - 1):
        if min(before[knot] - before[kept[-1]], len(parameter) - before[knot]) >= _FEWEST:
            kept.append(knot)
    return knots[[*kept, -1]]
