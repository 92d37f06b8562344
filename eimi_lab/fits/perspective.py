"""Detect in the measured edges that the lens shows the depth of the beam in perspective.

An ordinary lens shows the union of the outlines of the near face and the far face. To first order each edge is
displaced outward by a depth / (2 S). Here a is the distance of the edge from the optical axis along the normal of the
edge, and S is the stand-off of the lens. A bent beam therefore appears wider where its edges are farther from the axis.
A bent solid also bows across its depth by about κ depth² / 16, where κ is the curvature of the beam. This bow widens
the outline, too. The apparent width w is therefore fitted as

    w = w₀(s) + b a + c κ,    a = a_left + a_right,    S = depth / (2 b)

over all stations s along the beam and over all states. The width w₀ at each station is free, so that an irregular shape
of the beam has no influence. A bent beam also becomes slightly thinner. This makes the estimated S too large by some
tenths of its value, so that the stand-off should be measured and not taken from this estimate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.evidence.measurements import EdgeObservation

Array = NDArray[np.float64]

_STATIONS = np.linspace(0.1, 0.9, 17)  # along the beam, away from clamp and tip
_FEWEST_STATES = 4
_SURE = 6.0  # smallest slope b that counts, in standard errors (jackknife over the states)


@dataclass(frozen=True)
class SeenDepth:
    """The stand-off (mm) that explains the edges, and the largest change of width (mm) due to this stand-off."""

    stand_off_mm: float
    change_mm: float


def seen_depth(observed: EdgeObservation, centre_mm: Array, depth_mm: float) -> SeenDepth | None:
    """Estimate the stand-off of the lens from the edges of K states; None if no perspective is significant.

    Parameters
    ----------
    observed : EdgeObservation
    centre_mm : ndarray, shape (2,)
        Intersection of the optical axis with the plane of the beam.
    depth_mm : float
        Depth of the beam.
    """
    if len(observed.points_mm) < _FEWEST_STATES:
        return None
    count = len(observed.points_mm)
    profiles = np.array([_profile(observed, k, centre_mm) for k in range(count)])
    slope = _slope(profiles)
    without_one = np.array([_slope(np.delete(profiles, k, axis=0)) for k in range(count)])
    error = np.sqrt((count - 1) / count * np.sum((without_one - without_one.mean()) ** 2))
    if not slope > _SURE * error or not slope > 0:
        return None
    return SeenDepth(0.5 * depth_mm / slope, float(slope * np.ptp(profiles[:, 1], axis=0).max()))


def _slope(profiles: Array) -> float:
    """Return the slope b of the apparent width, from the profiles (K, 3, S) of K states at S stations.

    The mean over the states is subtracted, which removes the free width w₀ of each station.
    """
    width, distance, curvature = (profiles - profiles.mean(axis=0)).transpose(1, 0, 2).reshape(3, -1)
    return float(np.linalg.lstsq(np.stack([distance, curvature], axis=1), width, rcond=None)[0][0])


def _profile(observed: EdgeObservation, k: int, centre_mm: Array) -> Array:
    """Return width, distance from the optical axis, and curvature of state k at the S stations, shape (3, S)."""
    left, right = (
        side[np.isfinite(sigma)] for side, sigma in zip(observed.points_mm[k], observed.sigma_mm[k], strict=True)
    )
    middle = 0.5 * (_at_stations(left) + _at_stations(right))
    tangent = np.gradient(middle, axis=0)
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1) / np.linalg.norm(tangent, axis=1, keepdims=True)
    ends = [_crossing(side, middle, normal) for side in (left, right)]
    distances = sum(np.abs(((middle + end[:, None] * normal - centre_mm) * normal).sum(axis=1)) for end in ends)
    turned = np.gradient(np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0])))
    curvature = np.abs(turned) / np.linalg.norm(tangent, axis=1)
    return np.stack([np.abs(ends[1] - ends[0]), np.asarray(distances), curvature])


def _at_stations(points: Array) -> Array:
    """Return the points (S, 2) of an edge (n, 2) at the S stations, which are fractions of its arc length."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at = _STATIONS * length[-1]
    return np.stack([np.interp(at, length, points[:, i]) for i in range(2)], axis=1)


def _crossing(points: Array, middle: Array, normal: Array) -> Array:
    """Return the distances (S,) of an edge (n, 2) from middle points (S, 2) of the beam, along normals (S, 2)."""
    tangent = np.stack([normal[:, 1], -normal[:, 0]], axis=1)
    arms = points[None] - middle[:, None]
    across, along = ((arms * axis[:, None]).sum(axis=2) for axis in (normal, tangent))
    near = np.argsort(np.abs(along), axis=1)[:, :6]  # fit a parabola to the nearest points, and evaluate it at 0
    x, y = (np.take_along_axis(component, near, axis=1) for component in (along, across))
    powers = (x / np.abs(x).max(axis=1, keepdims=True))[..., None] ** np.arange(3)
    return np.asarray((np.linalg.pinv(powers)[:, 0] * y).sum(axis=1))
