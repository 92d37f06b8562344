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

from eimi_fitting.forward import BeamModel, Shapes
from eimi_fitting.nuisance import Setting

Array = NDArray[np.float64]


def edge_curves(model: BeamModel, shapes: Shapes) -> Array:
    """(P, K, 2, S, 3, 2): left (y < 0 at rest) and right edge as S quadratic segments of three points, clamp to tip.

    Each element side is one segment, a full-width magnet's side too, which stays straight.
    """
    place = model.mesh.nodes + shapes.displacement
    sides = np.stack([place[:, :, model.mesh.row(0)], place[:, :, model.mesh.row(-1)]], axis=2)
    return np.stack([sides[..., 0:-1:2, :], sides[..., 1::2, :], sides[..., 2::2, :]], axis=-2)


def points_on(curves: Array, per_segment: int) -> Array:
    """(..., S, 3, 2) -> (..., S * per_segment + 1, 2): the curve as a fine polyline."""
    xi = np.linspace(-1, 1, per_segment + 1)[:-1]
    shape = np.stack([0.5 * xi * (xi - 1), 1 - xi * xi, 0.5 * xi * (xi + 1)])
    inner = np.einsum("...sad,ax->...sxd", curves, shape)
    inner = inner.reshape(*curves.shape[:-3], -1, 2)
    return np.concatenate([inner, curves[..., -1, 2:3, :]], axis=-2)


def signed_distance(curves: Array, points: Array) -> Array:
    """Distance (..., n) of points (..., n, 2) to curves (..., S, 3, 2); positive to the left of clamp-to-tip.

    The nearest of four stations a segment, then Newton for the foot of the perpendicular on that segment's parabola.
    """
    stations = points_on(curves, 4)
    segments = curves.shape[-3]
    # |p - v|² without |p|²: enough to find the nearest station, and a matrix product.
    score = np.sum(stations**2, axis=-1)[..., None, :] - 2 * np.matmul(points, stations.swapaxes(-1, -2))
    nearest = np.argmin(score, axis=-1)
    segment = np.minimum(nearest // 4, segments - 1)
    xi = -1 + 0.5 * (nearest - 4 * segment)
    lowest = np.where(segment == 0, -1.0, -1.5)
    highest = np.where(segment == segments - 1, 1.0, 1.5)
    own = np.take_along_axis(curves, segment[..., None, None], axis=-3)  # (..., n, 3, 2)
    bend = own[..., 0, :] - 2 * own[..., 1, :] + own[..., 2, :]
    slope = 0.5 * (own[..., 2, :] - own[..., 0, :])
    for _ in range(3):
        gap = own[..., 1, :] + xi[..., None] * (slope + 0.5 * xi[..., None] * bend) - points
        tangent = slope + xi[..., None] * bend
        curvature = np.sum(tangent**2, axis=-1) + np.sum(gap * bend, axis=-1)
        step = np.sum(gap * tangent, axis=-1) / np.maximum(curvature, 1e-12)
        xi = np.clip(xi - step, lowest, highest)
    gap = points - own[..., 1, :] - xi[..., None] * (slope + 0.5 * xi[..., None] * bend)
    tangent = slope + xi[..., None] * bend
    side = tangent[..., 0] * gap[..., 1] - tangent[..., 1] * gap[..., 0]
    return np.asarray(np.copysign(np.sqrt(np.sum(gap**2, axis=-1)), side))


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


@dataclass(frozen=True)
class Perspective:
    """An ordinary lens before a specimen with depth: it sees the union of the near and the far face's outline.

    centre_mm: (2,) where the optical axis meets the middle plane; stand_off_mm: from the entrance pupil to that plane.
    Places are as the middle plane's scale has them. Raises ValueError where the specimen reaches the pupil.
    """

    centre_mm: Array
    stand_off_mm: float
    depth_mm: float

    def __post_init__(self) -> None:
        if not 0.5 * self.depth_mm < self.stand_off_mm:
            raise ValueError(f"a stand-off of {self.stand_off_mm:g} mm is within the depth of {self.depth_mm:g} mm")

    def faces(self, places_mm: Array) -> tuple[Array, Array]:
        """Where places (..., 2) of the near and of the far face appear."""
        near, far = (
            self.centre_mm + self.stand_off_mm / (self.stand_off_mm + half) * (places_mm - self.centre_mm)
            for half in (-0.5 * self.depth_mm, 0.5 * self.depth_mm)
        )
        return near, far

    def distance_to_union(self, curves: Array, points: Array) -> Array:
        """`signed_distance` of points (..., 2, n, 2) to left and right edge of the union of both faces.

        Beside an edge the face that reaches farther out hides the other's, and from it the outward distance is less.
        """
        near, far = (signed_distance(face, points) for face in self.faces(curves))
        outward = np.array([-1.0, 1.0])[:, None]  # the left edge's outside is to the right of clamp-to-tip
        return np.asarray(outward * np.minimum(outward * near, outward * far))


@dataclass(frozen=True)
class EdgeObservation:
    """Measured edges of K states: points_mm (K, 2, n, 2) left and right; sigma_mm (K, 2, n), infinite where unused.

    perspective: of the lens; None where it is telecentric or its stand-off unknown.
    """

    points_mm: Array
    sigma_mm: Array
    perspective: Perspective | None = None

    @staticmethod
    def from_edges(
        edges: Sequence[tuple[Array, Array, Array, Array]], perspective: Perspective | None = None
    ) -> EdgeObservation:
        """Pad (left (n, 2), left sigma (n,), right (m, 2), right sigma (m,)) of each state to one array."""
        most = max(len(points) for left, _, right, _ in edges for points in (left, right))
        points = np.zeros((len(edges), 2, most, 2))
        sigma = np.full((len(edges), 2, most), np.inf)
        for k, (left, left_sigma, right, right_sigma) in enumerate(edges):
            for side, (p, s) in enumerate(((left, left_sigma), (right, right_sigma))):
                points[k, side, : len(p)] = p
                sigma[k, side, : len(p)] = s
        return EdgeObservation(points, sigma, perspective)

    def of_states(self, states: NDArray[np.intp]) -> EdgeObservation:
        """What was seen in some of the states."""
        return replace(self, points_mm=self.points_mm[states], sigma_mm=self.sigma_mm[states])

    def misfit(
        self, model: BeamModel, shapes: Shapes, setting: Setting | None = None, change: Array | None = None
    ) -> Misfit:
        """Signed distances to the simulated edges, their RMS and standard deviation by state; change: is added."""
        curves = edge_curves(model, shapes)
        if setting is None:
            points = np.broadcast_to(self.points_mm, (len(curves), *self.points_mm.shape))
        else:
            points = setting.corrected(self.points_mm)
        weights = np.isfinite(self.sigma_mm).astype(float)
        distance_to = self.perspective.distance_to_union if self.perspective else signed_distance
        residuals = distance_to(curves, points) * weights
        if change is not None:
            residuals = residuals + change
        total = np.maximum(weights.sum(axis=(1, 2)), 1.0)
        distance = np.abs(residuals)
        mean = distance.sum(axis=(2, 3)) / total
        square = (distance**2).sum(axis=(2, 3)) / total
        return Misfit(residuals, weights, np.sqrt(square), np.sqrt(np.maximum(square - mean**2, 0.0)))


@dataclass(frozen=True)
class PointObservation:
    """Tracked material points of K states: rest_mm, moved_mm (K, n, 2), sigma_mm (K, n), infinite where unused."""

    rest_mm: Array
    moved_mm: Array
    sigma_mm: Array

    def of_states(self, states: NDArray[np.intp]) -> PointObservation:
        """What was seen in some of the states."""
        return PointObservation(self.rest_mm[states], self.moved_mm[states], self.sigma_mm[states])

    def misfit(
        self, model: BeamModel, shapes: Shapes, setting: Setting | None = None, change: Array | None = None
    ) -> Misfit:
        """Component differences to the simulated places; the distance of the metric is that of the point.

        change: is added to the differences.
        """
        k_states, n, _ = self.rest_mm.shape
        everywhere = model.positions(shapes, self.rest_mm.reshape(-1, 2))
        own = everywhere.reshape(len(everywhere), k_states, k_states, n, 2)
        simulated = own[:, np.arange(k_states), np.arange(k_states)]
        seen = np.isfinite(self.sigma_mm).astype(float)
        moved = self.moved_mm if setting is None else setting.corrected(self.moved_mm)
        residuals = (moved - simulated).transpose(0, 1, 3, 2) * seen[:, None]
        if change is not None:
            residuals = residuals + change
        distance = np.sqrt((residuals**2).sum(axis=2))
        total = np.maximum(seen.sum(axis=1), 1.0)
        mean = distance.sum(axis=2) / total
        square = (distance**2).sum(axis=2) / total
        weights = np.repeat(0.5 * seen[:, None], 2, axis=1)  # a point has two components
        return Misfit(residuals, weights, np.sqrt(square), np.sqrt(np.maximum(square - mean**2, 0.0)))


Observation = EdgeObservation | PointObservation
