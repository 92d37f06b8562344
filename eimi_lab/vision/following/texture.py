"""Average the points of a rough edge (folds, texture) along the edge."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import Chebyshev
from numpy.typing import NDArray

from eimi_lab.vision.edges.profiles import normals_of
from eimi_lab.vision.following.edge_points import StripEdges

Array = NDArray[np.float64]

_ROUGH_PX = 0.5  # scatter about a smooth line that the noise of the pixels does not cause at a clear edge
_LONGEST = 0.25  # widths: largest standard deviation of the weights of the average
_LEAST_SHARE = 0.5  # of the scatter that must remain: the stated deviation is computed from it
_TRIED = 12  # lengths of the average
_DEGREE = 7  # of the polynomial about which the points scatter: a bent beam needs no higher one
_FEWEST = 2 * _DEGREE  # points
_ALONE = 1e-9  # relative variance of the places in an average: below it, a point has no neighbour


def average_texture(edge: StripEdges, width_px: float) -> StripEdges:
    """Average the points of an edge along the edge, if they scatter by more than half a pixel about a smooth line.

    `width_px`: width of the beam according to the specimen file.
    """
    if len(edge.points) < _FEWEST:
        return edge
    line = _SmoothLine.through(edge.points)
    if line.scatter < _ROUGH_PX:
        return edge
    # Folds and texture displace neighbouring points by similar amounts, much larger than the noise of the pixels. The
    # edge of a bent beam is smooth over half a width.
    # local straight lines with Gaussian weights (W. S. Cleveland, J. Am. Stat. Assoc. 74 (1979) 829), as wide as the
    # bend of the beam and the estimate of the scatter permit
    best = None
    for length_px in _LONGEST * width_px * np.arange(1, _TRIED + 1) / _TRIED:
        averaged = _averaged(line.along, line.offset, length_px)
        if (averaged**2).sum() < _LEAST_SHARE**2 * (line.offset**2).sum():
            break
        best = averaged
    if best is None:
        return edge
    points = edge.points + (best - line.offset)[:, None] * line.normal
    share = min(1.0, _SmoothLine.through(points).scatter / math.sqrt(float((edge.sigma**2).mean())))
    return replace(edge, points=points, sigma=share * edge.sigma)


@dataclass(frozen=True)
class _SmoothLine:
    """A smooth line that is fitted to the n points of an edge: x and y are polynomials in the arc length.

    Attributes
    ----------
    along : ndarray, shape (n,)
        Arc length of each point, px.
    offset : ndarray, shape (n,)
        Signed distance of each point from the line, px.
    normal : ndarray, shape (n, 2)
        Unit normal of the line at each point.
    scatter : float
        Standard deviation of the points about the line, px.
    """

    along: Array
    offset: Array
    normal: Array
    scatter: float

    @classmethod
    def through(cls, points: Array) -> _SmoothLine:
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
        x, y = (Chebyshev.fit(along, places, _DEGREE) for places in points.T)
        tangent = np.column_stack([x.deriv()(along), y.deriv()(along)])
        normal = normals_of(tangent / np.linalg.norm(tangent, axis=1, keepdims=True))
        offset = ((points - np.column_stack([x(along), y(along)])) * normal).sum(axis=1)
        return cls(along, offset, normal, math.sqrt(float((offset**2).sum()) / (len(points) - _DEGREE - 1)))


def _averaged(along: Array, values: Array, length_px: float) -> Array:
    away = along - along[:, None]
    weight = np.exp(-0.5 * (away / length_px) ** 2)
    total, first, second = (np.asarray((weight * away**power).sum(axis=1)) for power in (0, 1, 2))
    spread = total * second - first**2
    alone = spread <= _ALONE * (total * length_px) ** 2
    spread = np.where(alone, 1.0, spread)
    line = ((weight * (second[:, None] - first[:, None] * away)) @ values) / spread
    return np.asarray(np.where(alone, values, line))
