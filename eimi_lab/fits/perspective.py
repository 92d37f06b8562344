"""Detect in the measured edges that the lens is not telecentric: near parts of the beam look larger than far parts.

At the stations s (fractions of the arc length) of all states, the apparent width w of the beam is fitted by

    w = w₀(s) + b a + c κ.

Here w₀ is the width at each station, a is the sum of the absolute distances of both edges from the optical axis, and κ
is the curvature of the beam, because anticlastic bending makes the beam look wider. A lens at the distance S
(stand-off) makes the beam wider by depth / (2 S) times the distance a. Therefore, S = depth / (2 b).
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
    """The perspective of a lens, estimated from the measured edges.

    Attributes
    ----------
    stand_off_mm : float
        Distance of the lens from the beam.
    change_mm : float
        Largest resulting change of the beam's apparent width.
    """

    stand_off_mm: float
    change_mm: float


def seen_depth(observed: EdgeObservation, centre_mm: Array, depth_mm: float) -> SeenDepth | None:
    """Estimate the distance of the lens from the beam; None without significant perspective in the edges.

    Parameters
    ----------
    observed : EdgeObservation
        Measured edges in all states (load steps).
    centre_mm : ndarray, shape (2,)
        x and y of the optical axis in the plane of the beam.
    depth_mm : float
        Size of the beam along the optical axis.
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
    """Return how much the beam appears wider for each mm from the optical axis.

    `profiles` contains width, distance from the axis, and curvature at m places along the beam, shape (states, 3, m).
    """
    # The width of each station is free (the mean over the states is subtracted). The curvature is a second cause: the
    # cross-section of a bent beam bows by about curvature * depth^2 / 16. The thinning of a bent beam is neglected, so
    # that the estimated stand-off is too large by some tenths of its value.
    width, distance, curvature = (profiles - profiles.mean(axis=0)).transpose(1, 0, 2).reshape(3, -1)
    return float(np.linalg.lstsq(np.stack([distance, curvature], axis=1), width, rcond=None)[0][0])


def _profile(observed: EdgeObservation, k: int, centre_mm: Array) -> Array:
    # Return, at m places along the beam in state k, the apparent width (mm), the sum of the distances of both edges
    # from the optical axis (mm), and the curvature (1/mm) of the middle line, (3, m).
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
    """Return x and y of an edge at m fixed fractions of the arc length, shape (m, 2)."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at = _STATIONS * length[-1]
    return np.stack([np.interp(at, length, points[:, i]) for i in range(2)], axis=1)


def _crossing(points: Array, middle: Array, normal: Array) -> Array:
    """Return the signed distance of an edge from m points, along the unit normals at these points, shape (m,).

    `points` are points of the edge, `middle` the m points, and `normal` the unit normals. The last axis is x and y.
    """
    tangent = np.stack([normal[:, 1], -normal[:, 0]], axis=1)
    arms = points[None] - middle[:, None]
    across, along = ((arms * axis[:, None]).sum(axis=2) for axis in (normal, tangent))
    near = np.argsort(np.abs(along), axis=1)[:, :6]  # fit a parabola to the nearest points, and evaluate it at 0
    x, y = (np.take_along_axis(component, near, axis=1) for component in (along, across))
    powers = (x / np.abs(x).max(axis=1, keepdims=True))[..., None] ** np.arange(3)
    return np.asarray((np.linalg.pinv(powers)[:, 0] * y).sum(axis=1))
