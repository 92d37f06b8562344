"""Detect in the measured edges that the lens is not telecentric: near parts of the beam look larger than far parts.

An ordinary lens shows the near face of the beam larger than the far face, and the outline in the picture encloses both
faces. Let S be the stand-off of the lens (its distance from the beam), and a the distance of an edge from the optical
axis, measured along the normal of the edge. To first order the edge appears farther out by a · depth / (2 S). A bent
beam therefore appears wider where its edges are farther from the axis.

A second effect also widens the outline: the cross-section of a bent beam bows across its depth by about κ depth² / 16,
where κ is the curvature of the beam. To separate the two effects, the apparent width w is fitted by

    w = w₀(s) + b a + c κ,    a = a_left + a_right,    S = depth / (2 b)

at all stations s along the beam and in all states. A station is a place on the beam, given as a fraction of the arc
length. The two edges have the distances a_left and a_right, and b and c are coefficients of the fit. The width w₀ of
each station is free, so that an irregular shape of the beam has no influence.

A bent beam also becomes slightly thinner, which the fit neglects. Therefore the estimated S is too large by some tenths
of its value. The stand-off should be measured and not taken from this estimate.
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
        The stand-off of the lens (its distance from the beam) that explains the edges.
    change_mm : float
        The largest change of the beam's width in the picture due to this stand-off.
    """

    stand_off_mm: float
    change_mm: float


def seen_depth(observed: EdgeObservation, centre_mm: Array, depth_mm: float) -> SeenDepth | None:
    """Estimate the stand-off of the lens (its distance from the beam) from the edges in several states (load steps).

    The result is None if the edges show no significant perspective.

    Parameters
    ----------
    observed : EdgeObservation
        The measured edges in all states (load steps).
    centre_mm : ndarray, shape (2,)
        x and y in the beam frame of the intersection of the optical axis with the plane of the beam.
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
    """Return how much the beam appears wider for each mm from the optical axis, by a linear fit.

    `profiles` has the shape (K, 3, m) for K states and m stations (places along the beam). Its second axis contains the
    apparent width, the sum of the distances of both edges from the optical axis, and the curvature. At each station,
    only changes between the states count, so that an irregular width of the beam has no influence.
    """
    width, distance, curvature = (profiles - profiles.mean(axis=0)).transpose(1, 0, 2).reshape(3, -1)
    return float(np.linalg.lstsq(np.stack([distance, curvature], axis=1), width, rcond=None)[0][0])


def _profile(observed: EdgeObservation, k: int, centre_mm: Array) -> Array:
    """Return three profiles of the beam in state k at m stations (places along the beam), shape (3, m).

    The rows are the apparent width (mm), the sum of the distances of both edges from the optical axis (mm), and the
    curvature (1/mm).
    """
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
    """Return x and y of an edge at the m stations, shape (m, 2). A station is a fixed fraction of the arc length.

    `points` contains x and y of n points of the edge, shape (n, 2).
    """
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at = _STATIONS * length[-1]
    return np.stack([np.interp(at, length, points[:, i]) for i in range(2)], axis=1)


def _crossing(points: Array, middle: Array, normal: Array) -> Array:
    """Return the signed distance of an edge from the middle line, along the normals at m middle points, shape (m,).

    `points` contains n points of the edge, shape (n, 2). `middle` contains the middle points, and `normal` the unit
    vectors normal to the middle line at these points, both of shape (m, 2). The last axes contain x and y.
    """
    tangent = np.stack([normal[:, 1], -normal[:, 0]], axis=1)
    arms = points[None] - middle[:, None]
    across, along = ((arms * axis[:, None]).sum(axis=2) for axis in (normal, tangent))
    near = np.argsort(np.abs(along), axis=1)[:, :6]  # fit a parabola to the nearest points, and evaluate it at 0
    x, y = (np.take_along_axis(component, near, axis=1) for component in (along, across))
    powers = (x / np.abs(x).max(axis=1, keepdims=True))[..., None] ** np.arange(3)
    return np.asarray((np.linalg.pinv(powers)[:, 0] * y).sum(axis=1))
