"""What the edges themselves say of the lens: whether the beam's depth is seen in perspective, and from how far.

An ordinary lens sees the union of the outlines of the near and the far face. To first order each edge is moved outward
by d depth / (2 S), with d its distance from the optical axis along its normal and S the stand-off: a beam that bends
looks the wider, the farther its edges are from the axis. Each place along the beam is compared with itself in other
states, so that a beam that is not cut true has no say.

A solid also bows across its depth where it is bent: its faces stand out by about kappa depth^2 / 16 on one side, which
widens the outline as curvature does, and curvature grows with the distance from the axis. So the width is taken as a
sum of both, and only what the distance explains beside the curvature counts. A beam also grows a little thinner where
it is bent, which makes the stand-off come out too large, by some tenths of it: it is to be measured, not taken from
here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.evidence.measurements import EdgeObservation

Array = NDArray[np.float64]

_STATIONS = np.linspace(0.1, 0.9, 17)  # along the beam, clear of clamp and tip
_FEWEST_STATES = 4
_SURE = 6.0  # standard errors, by leaving out one state at a time


@dataclass(frozen=True)
class SeenDepth:
    """The stand-off (mm) from which the edges look as if seen, and by how much (mm) the width then changes at most."""

    stand_off_mm: float
    change_mm: float


def seen_depth(observed: EdgeObservation, centre_mm: Array, depth_mm: float) -> SeenDepth | None:
    """What perspective is in the edges of K states; None where there is none to be seen.

    centre_mm: (2,) where the optical axis meets the beam's plane.
    """
    if len(observed.points_mm) < _FEWEST_STATES:
        return None
    count = len(observed.points_mm)
    seen = np.array([_along(observed, k, centre_mm) for k in range(count)])
    slope = _slope(seen)
    rest = np.array([_slope(np.delete(seen, k, axis=0)) for k in range(count)])
    error = np.sqrt((count - 1) / count * np.sum((rest - rest.mean()) ** 2))
    if not slope > _SURE * error or not slope > 0:
        return None
    return SeenDepth(0.5 * depth_mm / slope, float(slope * np.ptp(seen[:, 1], axis=0).max()))


def _slope(seen: Array) -> float:
    """Of width in distance beside curvature, from (K, 3, S), each station's mean over the states taken off."""
    width, distance, curvature = (seen - seen.mean(axis=0)).transpose(1, 0, 2).reshape(3, -1)
    return float(np.linalg.lstsq(np.stack([distance, curvature], axis=1), width, rcond=None)[0][0])


def _along(observed: EdgeObservation, k: int, centre_mm: Array) -> Array:
    """(3, S) at each station: width, the sum of both edges' distances from the axis along their normals, curvature."""
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
    """(S, 2) of an edge (n, 2), by its length."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at = _STATIONS * length[-1]
    return np.stack([np.interp(at, length, points[:, i]) for i in range(2)], axis=1)


def _crossing(points: Array, middle: Array, normal: Array) -> Array:
    """(S,): how far along each normal an edge (n, 2) lies from the middle."""
    tangent = np.stack([normal[:, 1], -normal[:, 0]], axis=1)
    arms = points[None] - middle[:, None]
    across, along = ((arms * axis[:, None]).sum(axis=2) for axis in (normal, tangent))
    near = np.argsort(np.abs(along), axis=1)[:, :6]  # a parabola through the nearest points, and its place at 0
    x, y = (np.take_along_axis(own, near, axis=1) for own in (along, across))
    powers = (x / np.abs(x).max(axis=1, keepdims=True))[..., None] ** np.arange(3)
    return np.asarray((np.linalg.pinv(powers)[:, 0] * y).sum(axis=1))
