"""Compute the distances of measured edges and tracked points from simulated edges and points."""

# Let d_ki be the distance in mm of the measured point i in load case k, which has N_k points. Error and deviation of
# load case k, both in mm, are adapted from Eqs 9-11 of Di Lecce et al. 2022 (Front. Robot. AI 8:790571):
#
#     error_k     = sqrt(sum_i d_ki^2 / N_k)
#     deviation_k = sqrt(error_k^2 - (sum_i |d_ki| / N_k)^2)

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
# A measured point may lie beyond the end of its simulated edge, for example if the beam is a little longer than
# specified. Without a straight continuation of the edge, the distance would be measured from the end of the edge, and
# would jump from positive to negative between the two sides of the edge. In one load case, such a jump made the
# derivatives of the residuals about four times too large, and the interval of the modulus a third as wide as it should
# be.
_CONTINUED = 0.05  # length of the straight continuation of an edge, as a share of the length of the edge
# Number of load cases that are compared in one block. The arrays of more load cases exceed the processor's cache.
_STATES_AT_ONCE = 16
# Number of pairs of a measured point and a point of a simulated edge in one block, which needs 2 MB of the cache.
_PAIRS_AT_ONCE = 1 << 18

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
    """Return the signed distances of points from curves that are continued straight beyond their ends."""
    # curves (..., S, 3, 2): S parabolic segments with three points each, x and y in mm. points (..., n, 2): n points
    # for each curve. The distances (..., n) are positive to the left of the curve.
    alone = np.broadcast_shapes(curves.shape[:-3], points.shape[:-2])
    curves = np.broadcast_to(curves, (*alone, *curves.shape[-3:])).reshape(-1, *curves.shape[-3:])
    points = np.broadcast_to(points, (*alone, *points.shape[-2:])).reshape(-1, *points.shape[-2:])
    n = points.shape[1]
    rows = max(_PAIRS_AT_ONCE // max(4 * curves.shape[1] * n, 1), 1)
    distance = np.empty(points.shape[:2])
    for first in range(0, len(points), rows):
        some = slice(first, first + rows)
        distance[some] = _signed_distance(curves[some], points[some])
    return distance.reshape(*alone, n)


def _signed_distance(curves: Array, points: Array) -> Array:
    stations = points_on(curves, 4)
    segments = curves.shape[-3]
    # |p - v|² - |p|² has its minimum at the nearest station. It is one product of (x, y, 1) and (-2 x, -2 y, |v|²).
    ahead = np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)
    behind = np.concatenate([-2 * stations, (stations**2).sum(axis=-1, keepdims=True)], axis=-1)
    nearest = np.argmin(np.matmul(ahead, behind.swapaxes(-1, -2)), axis=-1)
    segment = np.minimum(nearest // 4, segments - 1)
    xi = -1 + 0.5 * (nearest - 4 * segment)
    lowest = np.where(segment == 0, -1.0, -1.5)
    highest = np.where(segment == segments - 1, 1.0, 1.5)
    first, middle, last = np.moveaxis(curves, -2, 0)

    def of_nearest(of_segment: Array) -> tuple[Array, Array]:
        # At the segment nearest to each point.
        # ``of_segment`` contains one vector for each segment, such as the tangent in its middle.
        # two arrays, because operations on an axis of length two are slower
        x, y = (np.take_along_axis(of_segment[..., i], segment, axis=-1) for i in range(2))
        return x, y

    bend_x, bend_y = of_nearest(first - 2 * middle + last)
    slope_x, slope_y = of_nearest(0.5 * (last - first))
    from_x, from_y = of_nearest(middle)
    from_x, from_y = from_x - points[..., 0], from_y - points[..., 1]

    def gap_and_tangent(xi: Array) -> tuple[Array, Array, Array, Array]:
        # The vector from each point to the curve, and the tangent of the curve there.
        # ``xi`` is the position on the nearest segment, from -1 to 1.
        tangent_x, tangent_y = slope_x + xi * bend_x, slope_y + xi * bend_y
        gap_x = from_x + xi * (slope_x + 0.5 * xi * bend_x)
        gap_y = from_y + xi * (slope_y + 0.5 * xi * bend_y)
        return gap_x, gap_y, tangent_x, tangent_y

    # Newton's method: the vector to the point becomes perpendicular to the curve
    for _ in range(3):
        gap_x, gap_y, tangent_x, tangent_y = gap_and_tangent(xi)
        curvature = tangent_x**2 + tangent_y**2 + gap_x * bend_x + gap_y * bend_y
        step = (gap_x * tangent_x + gap_y * tangent_y) / np.maximum(curvature, 1e-12)
        xi = np.clip(xi - step, lowest, highest)
    gap_x, gap_y, tangent_x, tangent_y = gap_and_tangent(xi)
    size = np.maximum(np.hypot(tangent_x, tangent_y), 1e-12)
    across, along = (tangent_y * gap_x - tangent_x * gap_y) / size, (tangent_x * gap_x + tangent_y * gap_y) / size
    is_at_end = ((segment == 0) & (xi <= -1.0)) | ((segment == segments - 1) & (xi >= 1.0))
    length = np.linalg.norm(last - first, axis=-1).sum(axis=-1, keepdims=True)
    remaining = np.maximum(np.abs(along) - _CONTINUED * length * is_at_end, 0.0)
    return np.asarray(np.copysign(np.hypot(across, remaining), across))


@dataclass(frozen=True)
class Misfit:
    """The residuals of several simulations: the distances of measured points from the simulated beam."""

    # There are P candidate sets of parameters and K load cases.

    # (P, K, 2, n): signed residuals in mm of n points of the two edges, or in x and y of n tracked points.
    residuals: Array
    # (K, 2, n): 1 for a point of an edge, 1/2 for a coordinate of a tracked point, 0 for an unused point.
    weights: Array
    # (P, K): root mean square of the distances, and standard deviation of their absolute values.
    error_mm: Array
    deviation_mm: Array

    def take(self, rows: NDArray[np.intp]) -> Misfit:
        """Return the residuals of some of the candidate sets of parameters."""
        return Misfit(self.residuals[rows], self.weights, self.error_mm[rows], self.deviation_mm[rows])


def joined_misfits(misfits: Sequence[Misfit]) -> Misfit:
    """Join the residuals of several groups of candidate sets of parameters."""
    return Misfit(
        residuals=np.concatenate([misfit.residuals for misfit in misfits]),
        weights=misfits[0].weights,
        error_mm=np.concatenate([misfit.error_mm for misfit in misfits]),
        deviation_mm=np.concatenate([misfit.deviation_mm for misfit in misfits]),
    )


@dataclass(frozen=True)
class EdgeObservation:
    """Measured left and right edges of the beam in K load cases.

    Parameters
    ----------
    points_mm : ndarray, shape (K, 2, n, 2)
        Positions of n points of the left and of the right edge: x along and y across the straight beam, from the clamp,
        in mm.
    sigma_mm : ndarray, shape (K, 2, n)
        Standard uncertainty of each point in mm; infinite for a point that is not used.
    view : View, optional
        Perspective of the lens. None if the lens is telecentric or if no file specifies its distance from the beam.
    noise_mm : ndarray, shape (K, 2, n), optional
        Standard deviation of the noise of each point in mm. ``sigma_mm`` contains this noise and an uncertainty for
        defects of the image.

    Examples
    --------
    One load case, with two points on the left edge and three on the right edge. The standard uncertainty of each point
    is 5 µm:

    >>> import numpy as np
    >>> left, right = np.array([[5.0, -1.5], [9.0, -1.5]]), np.array([[5.0, 1.5], [7.0, 1.5], [9.0, 1.5]])
    >>> observed = EdgeObservation.from_edges([(left, np.full(2, 0.005), right, np.full(3, 0.005))])
    >>> observed.points_mm.shape
    (1, 2, 3, 2)
    """

    points_mm: Array
    sigma_mm: Array
    view: View | None = None
    noise_mm: Array | None = None

    @staticmethod
    def from_edges(edges: Sequence[tuple[Array, Array, Array, Array]], view: View | None = None) -> EdgeObservation:
        """Return an observation from edges that may have different numbers of points.

        Parameters
        ----------
        edges : sequence of tuple of ndarray
            For each load case, the points of the left edge (n, 2), their standard uncertainties (n,), the points of the
            right edge (m, 2) and their standard uncertainties (m,), all in mm.
        view : View, optional
            Perspective of the lens.

        Returns
        -------
        EdgeObservation
            All edges with the same number of points. Shorter edges are filled up with unused points.
        """
        most = max(len(points) for left, _, right, _ in edges for points in (left, right))
        points = np.zeros((len(edges), 2, most, 2))
        sigma = np.full((len(edges), 2, most), np.inf)
        for k, (left, left_sigma, right, right_sigma) in enumerate(edges):
            for side, (p, s) in enumerate(((left, left_sigma), (right, right_sigma))):
                points[k, side, : len(p)] = p
                sigma[k, side, : len(p)] = s
        return EdgeObservation(points, sigma, view)

    def of_states(self, states: NDArray[np.intp]) -> EdgeObservation:
        """Return the measured edges in some of the load cases, given by their indices."""
        noise = None if self.noise_mm is None else self.noise_mm[states]
        return replace(self, points_mm=self.points_mm[states], sigma_mm=self.sigma_mm[states], noise_mm=noise)

    def misfit(self, model: Model, shapes: Shapes, setup: Setup | None = None, change: Array | None = None) -> Misfit:
        """Return the signed distances of the measured points from the simulated edges.

        Parameters
        ----------
        model : Model
            The simulated beam model.
        shapes : Shapes
            Simulated shapes of the beam, for each set of parameters and each load case.
        setup : Setup, optional
            Errors of the camera.
        change : ndarray, shape (K, 2, n), optional
            Correction of the distances in mm.
        """
        weights = np.isfinite(self.sigma_mm).astype(float)
        distances = []
        for first in range(0, len(weights), _STATES_AT_ONCE):
            block = slice(first, first + _STATES_AT_ONCE)
            curves = outline(model, replace(shapes, displacement=shapes.displacement[:, block]), self.view)
            measured = self.points_mm[block]
            points = (
                np.broadcast_to(measured, (len(curves), *measured.shape))
                if setup is None
                else setup.corrected(measured)
            )
            distances.append(signed_distance(curves, points))
        residuals = np.concatenate(distances, axis=1) * weights
        return self.of_residuals(residuals if change is None else residuals + change)

    def of_residuals(self, residuals: Array) -> Misfit:
        """Compute the root mean square and the standard deviation of signed distances (mm) of edge points."""
        weights = np.isfinite(self.sigma_mm).astype(float)
        total = np.maximum(weights.sum(axis=(1, 2)), 1.0)
        distance = np.abs(residuals)
        mean = distance.sum(axis=(2, 3)) / total
        square = (distance**2).sum(axis=(2, 3)) / total
        return Misfit(residuals, weights, np.sqrt(square), np.sqrt(np.maximum(square - mean**2, 0.0)))


@dataclass(frozen=True)
class PointObservation:
    """Tracked material points of the beam in K load cases.

    Parameters
    ----------
    rest_mm, moved_mm : ndarray, shape (K, n, 2)
        Positions of n points at rest (``rest_mm``) and under load (``moved_mm``): x along and y across the straight
        beam, from the clamp, in mm.
    sigma_mm : ndarray, shape (K, n)
        Standard uncertainty of each point in mm; infinite for a point that is not used.
    depth_mm : ndarray, shape (K, n), optional
        Distance of each point from the middle of the beam's depth in mm; zero by default. A planar model ignores it.

    Examples
    --------
    One marker in the middle of a beam's tip, in two load cases. The standard uncertainty of its position is 10 µm:

    >>> import numpy as np
    >>> rest = np.array([[[30.0, 0.0]], [[30.0, 0.0]]])
    >>> moved = np.array([[[29.9, 1.2]], [[29.6, 2.4]]])
    >>> observed = PointObservation(rest, moved, np.full((2, 1), 0.01))
    >>> observed.of_states(np.array([1])).moved_mm.tolist()
    [[[29.6, 2.4]]]
    """

    rest_mm: Array
    moved_mm: Array
    sigma_mm: Array
    depth_mm: Array | None = None

    def of_states(self, states: NDArray[np.intp]) -> PointObservation:
        """Return the tracked points in some of the load cases, given by their indices."""
        depth = None if self.depth_mm is None else self.depth_mm[states]
        return PointObservation(self.rest_mm[states], self.moved_mm[states], self.sigma_mm[states], depth)

    def misfit(self, model: Model, shapes: Shapes, setup: Setup | None = None, change: Array | None = None) -> Misfit:
        """Return the measured minus the simulated positions of the tracked points.

        Parameters
        ----------
        model : Model
            The simulated beam model.
        shapes : Shapes
            Simulated shapes of the beam, for each set of parameters and each load case.
        setup : Setup, optional
            Errors of the camera.
        change : ndarray, shape (K, 2, n), optional
            Correction of x and y in mm.
        """
        k_states, n, _ = self.rest_mm.shape
        rest = self.rest_mm.reshape(-1, 2)
        if not isinstance(model, BeamModel):
            depth = np.zeros(len(rest)) if self.depth_mm is None else self.depth_mm.ravel()
            rest = np.column_stack([rest, depth])
        points, index = np.unique(rest, axis=0, return_inverse=True)  # most points are tracked in all states
        positions = model.positions(shapes, points)[..., :2]
        simulated = positions[:, np.arange(k_states)[:, None], index.reshape(k_states, n)]
        is_used = np.isfinite(self.sigma_mm).astype(float)
        moved = self.moved_mm if setup is None else setup.corrected(self.moved_mm)
        residuals = (moved - simulated).transpose(0, 1, 3, 2) * is_used[:, None]
        return self.of_residuals(residuals if change is None else residuals + change)

    def of_residuals(self, residuals: Array) -> Misfit:
        """Compute the root mean square and the standard deviation of the distances (mm) of tracked points."""
        is_used = np.isfinite(self.sigma_mm).astype(float)
        distance = np.sqrt((residuals**2).sum(axis=2))
        total = np.maximum(is_used.sum(axis=1), 1.0)
        mean = distance.sum(axis=2) / total
        square = (distance**2).sum(axis=2) / total
        weights = np.repeat(0.5 * is_used[:, None], 2, axis=1)  # a point has two components
        return Misfit(residuals, weights, np.sqrt(square), np.sqrt(np.maximum(square - mean**2, 0.0)))


Observation = EdgeObservation | PointObservation
