"""Simulated edges and points, and how far the measured ones lie from them.

The metric (design of the study, after Eqs 9-11 of Di Lecce et al. 2022, in this project's own form): for state k the
distance d_ki from each observed edge point to the simulated edge of the same side; error_k its root mean square,
deviation_k its standard deviation; the objective is the mean of error_k over the states.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.model import BeamModel, Shapes
from eimi_fitting.beam.outline import Model, edge_curves, outline, points_on
from eimi_fitting.beam.view import View
from eimi_fitting.inference.evidence.unknowns import Setup

Array = NDArray[np.float64]
_STATES_AT_ONCE = 16
"""Whose points are compared with every station of their edges: the largest arrays of a fit, past the cache for more."""

__all__ = [
    "EdgeObservation",
    "Misfit",
    "Observation",
    "PointObservation",
    "edge_curves",
    "points_on",
    "signed_distance",
]


def signed_distance(curves: Array, points: Array) -> Array:
    """Distance (..., n) of points (..., n, 2) to curves (..., S, 3, 2); positive to the left of clamp-to-tip.

    The nearest of four stations a segment, then Newton for the foot of the perpendicular on that segment's parabola.
    """
    stations = points_on(curves, 4)
    segments = curves.shape[-3]
    # |p - v|² without |p|² is enough to find the nearest station: one product of (x, y, 1) and (-2 x, -2 y, |v|²).
    ahead = np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)
    behind = np.concatenate([-2 * stations, (stations**2).sum(axis=-1, keepdims=True)], axis=-1)
    nearest = np.argmin(np.matmul(ahead, behind.swapaxes(-1, -2)), axis=-1)
    segment = np.minimum(nearest // 4, segments - 1)
    xi = -1 + 0.5 * (nearest - 4 * segment)
    lowest = np.where(segment == 0, -1.0, -1.5)
    highest = np.where(segment == segments - 1, 1.0, 1.5)
    first, middle, last = np.moveaxis(curves, -2, 0)

    def own(of_segment: Array) -> tuple[Array, Array]:
        """Of each point's segment, x and y (..., n) apart: sums over two numbers a row are slow."""
        x, y = (np.take_along_axis(of_segment[..., i], segment, axis=-1) for i in range(2))
        return x, y

    bend_x, bend_y = own(first - 2 * middle + last)
    slope_x, slope_y = own(0.5 * (last - first))
    from_x, from_y = own(middle)
    from_x, from_y = from_x - points[..., 0], from_y - points[..., 1]

    def at(xi: Array) -> tuple[Array, Array, Array, Array]:
        """From the point to the curve, and the curve's tangent."""
        tangent_x, tangent_y = slope_x + xi * bend_x, slope_y + xi * bend_y
        gap_x = from_x + xi * (slope_x + 0.5 * xi * bend_x)
        gap_y = from_y + xi * (slope_y + 0.5 * xi * bend_y)
        return gap_x, gap_y, tangent_x, tangent_y

    for _ in range(3):
        gap_x, gap_y, tangent_x, tangent_y = at(xi)
        curvature = tangent_x**2 + tangent_y**2 + gap_x * bend_x + gap_y * bend_y
        step = (gap_x * tangent_x + gap_y * tangent_y) / np.maximum(curvature, 1e-12)
        xi = np.clip(xi - step, lowest, highest)
    gap_x, gap_y, tangent_x, tangent_y = at(xi)
    side = tangent_y * gap_x - tangent_x * gap_y
    return np.asarray(np.copysign(np.hypot(gap_x, gap_y), side))


@dataclass(frozen=True)
class Misfit:
    """P candidates against K states.

    residuals: (P, K, G, n) mm, in G groups within which neighbours may be correlated (left and right edge, or x and y);
    weights: (K, G, n) zero where nothing was observed; their sum over a state is its number of observed points, so
    that sum(residuals^2) / sum(weights) is error_mm^2; error_mm, deviation_mm: (P, K).
    """

    residuals: Array
    weights: Array
    error_mm: Array
    deviation_mm: Array

    def take(self, rows: NDArray[np.intp]) -> Misfit:
        """Return the misfit of some of the candidates."""
        return Misfit(self.residuals[rows], self.weights, self.error_mm[rows], self.deviation_mm[rows])


@dataclass(frozen=True)
class EdgeObservation:
    """Measured edges of K states: points_mm (K, 2, n, 2) left and right; sigma_mm (K, 2, n), infinite where unused.

    view: of the lens; None where it is telecentric or its stand-off unknown.

    Examples
    --------
    One state, two points on the left edge and three on the right one, each good to 5 µm:

    >>> import numpy as np
    >>> left, right = np.array([[5.0, -1.5], [9.0, -1.5]]), np.array([[5.0, 1.5], [7.0, 1.5], [9.0, 1.5]])
    >>> seen = EdgeObservation.from_edges([(left, np.full(2, 0.005), right, np.full(3, 0.005))])
    >>> seen.points_mm.shape
    (1, 2, 3, 2)
    """

    points_mm: Array
    sigma_mm: Array
    view: View | None = None

    @staticmethod
    def from_edges(edges: Sequence[tuple[Array, Array, Array, Array]], view: View | None = None) -> EdgeObservation:
        """Pad (left (n, 2), left sigma (n,), right (m, 2), right sigma (m,)) of each state to one array."""
        most = max(len(points) for left, _, right, _ in edges for points in (left, right))
        points = np.zeros((len(edges), 2, most, 2))
        sigma = np.full((len(edges), 2, most), np.inf)
        for k, (left, left_sigma, right, right_sigma) in enumerate(edges):
            for side, (p, s) in enumerate(((left, left_sigma), (right, right_sigma))):
                points[k, side, : len(p)] = p
                sigma[k, side, : len(p)] = s
        return EdgeObservation(points, sigma, view)

    def of_states(self, states: NDArray[np.intp]) -> EdgeObservation:
        """What was seen in some of the states."""
        return replace(self, points_mm=self.points_mm[states], sigma_mm=self.sigma_mm[states])

    def misfit(self, model: Model, shapes: Shapes, setup: Setup | None = None, change: Array | None = None) -> Misfit:
        """Signed distances to the simulated edges, their RMS and standard deviation by state; change: is added."""
        weights = np.isfinite(self.sigma_mm).astype(float)
        distances = []
        for first in range(0, len(weights), _STATES_AT_ONCE):
            block = slice(first, first + _STATES_AT_ONCE)
            curves = outline(model, replace(shapes, displacement=shapes.displacement[:, block]), self.view)
            seen = self.points_mm[block]
            points = np.broadcast_to(seen, (len(curves), *seen.shape)) if setup is None else setup.corrected(seen)
            distances.append(signed_distance(curves, points))
        residuals = np.concatenate(distances, axis=1) * weights
        return self.of_residuals(residuals if change is None else residuals + change)

    def of_residuals(self, residuals: Array) -> Misfit:
        """What residuals (P, K, 2, n) amount to."""
        weights = np.isfinite(self.sigma_mm).astype(float)
        total = np.maximum(weights.sum(axis=(1, 2)), 1.0)
        distance = np.abs(residuals)
        mean = distance.sum(axis=(2, 3)) / total
        square = (distance**2).sum(axis=(2, 3)) / total
        return Misfit(residuals, weights, np.sqrt(square), np.sqrt(np.maximum(square - mean**2, 0.0)))


@dataclass(frozen=True)
class PointObservation:
    """Tracked material points of K states: rest_mm, moved_mm (K, n, 2), sigma_mm (K, n), infinite where unused.

    depth_mm: (K, n) from mid-depth, which a planar model takes no notice of; None for points in mid-depth.

    Examples
    --------
    One marker in the middle of a beam's tip, in two states, good to 10 µm:

    >>> import numpy as np
    >>> rest = np.array([[[30.0, 0.0]], [[30.0, 0.0]]])
    >>> moved = np.array([[[29.9, 1.2]], [[29.6, 2.4]]])
    >>> seen = PointObservation(rest, moved, np.full((2, 1), 0.01))
    >>> seen.of_states(np.array([1])).moved_mm.tolist()
    [[[29.6, 2.4]]]
    """

    rest_mm: Array
    moved_mm: Array
    sigma_mm: Array
    depth_mm: Array | None = None

    def of_states(self, states: NDArray[np.intp]) -> PointObservation:
        """What was seen in some of the states."""
        depth = None if self.depth_mm is None else self.depth_mm[states]
        return PointObservation(self.rest_mm[states], self.moved_mm[states], self.sigma_mm[states], depth)

    def misfit(self, model: Model, shapes: Shapes, setup: Setup | None = None, change: Array | None = None) -> Misfit:
        """Component differences to the simulated places; the distance of the metric is that of the point.

        change: is added to the differences.
        """
        k_states, n, _ = self.rest_mm.shape
        rest = self.rest_mm.reshape(-1, 2)
        if not isinstance(model, BeamModel):
            depth = np.zeros(len(rest)) if self.depth_mm is None else self.depth_mm.ravel()
            rest = np.column_stack([rest, depth])
        points, which = np.unique(rest, axis=0, return_inverse=True)  # most are tracked through every state
        everywhere = model.positions(shapes, points)[..., :2]
        simulated = everywhere[:, np.arange(k_states)[:, None], which.reshape(k_states, n)]
        seen = np.isfinite(self.sigma_mm).astype(float)
        moved = self.moved_mm if setup is None else setup.corrected(self.moved_mm)
        residuals = (moved - simulated).transpose(0, 1, 3, 2) * seen[:, None]
        return self.of_residuals(residuals if change is None else residuals + change)

    def of_residuals(self, residuals: Array) -> Misfit:
        """What residuals (P, K, 2, n), of x and y, amount to."""
        seen = np.isfinite(self.sigma_mm).astype(float)
        distance = np.sqrt((residuals**2).sum(axis=2))
        total = np.maximum(seen.sum(axis=1), 1.0)
        mean = distance.sum(axis=2) / total
        square = (distance**2).sum(axis=2) / total
        weights = np.repeat(0.5 * seen[:, None], 2, axis=1)  # a point has two components
        return Misfit(residuals, weights, np.sqrt(square), np.sqrt(np.maximum(square - mean**2, 0.0)))


Observation = EdgeObservation | PointObservation
