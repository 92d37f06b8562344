"""Both edges of the beam in millimetres, with the flags (records of failed quality checks)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.check import Flag

Array = NDArray[np.float64]


@dataclass(frozen=True)
class EdgePoints:
    """The n points of one edge, ordered from the clamp to the tip.

    Attributes
    ----------
    points_mm : ndarray, shape (n, 2)
        x along the undeformed beam from the clamp, y across the beam.
    sigma_mm : ndarray, shape (n,)
        Standard deviation of each point perpendicular to the edge.
    """

    points_mm: Array
    sigma_mm: Array


@dataclass(frozen=True)
class EdgeSet:
    """Both edges of the beam in one picture, with corners and failed quality checks.

    Attributes
    ----------
    left, right : EdgePoints
        The edges; empty if no beam was found. Without coil field, the left edge has y < 0.
    flags : tuple of Flag
        The failed quality checks.
    corners_px : ndarray, shape (4, 2)
        Clamp-left, clamp-right, tip-left, tip-right; NaN for a corner that was not located.
    calibration_digest : str
        Checksum of the calibration.
    calibration_age_days : float, optional
        Age of the calibration when the picture was taken; None if unknown.
    """

    left: EdgePoints
    right: EdgePoints
    flags: tuple[Flag, ...]
    corners_px: Array
    calibration_digest: str = ""
    calibration_age_days: float | None = None

    @property
    def middle_mm(self) -> Array:
        """The centre line of the beam, mm, shape (n, 2); empty if an edge has no points."""
        left, right = self.left.points_mm, self.right.points_mm
        if not (len(left) and len(right)):
            return np.zeros((0, 2))
        nearest = ((left[:, None] - right) ** 2).sum(axis=2).argmin(axis=1)
        return np.asarray(0.5 * (left + right[nearest]))


END_SHARE = 0.1
"""The direction of the tip is measured over this share of the length of an edge, at the end of the edge."""


def tip_angle_deg(edges: EdgeSet) -> float:
    """Return the direction of the tip in degrees, from x (undeformed beam) toward y (across the beam).

    Parameters
    ----------
    edges : EdgeSet
        Both edges in one picture.

    Returns
    -------
    float
        Degrees; NaN without edges.
    """
    directions = [_end_direction(edge.points_mm) for edge in (edges.left, edges.right)]
    x, y = np.sum(directions, axis=0)
    return float(np.degrees(np.arctan2(y, x)))


def tip_angle_sigma_deg(edges: EdgeSet) -> float:
    """Return the standard uncertainty (degrees) of the direction of the tip due to noise.

    Parameters
    ----------
    edges : EdgeSet
        Both edges in one picture.

    Returns
    -------
    float
        Degrees; NaN without edges.
    """
    variance = 0.0
    for edge in (edges.left, edges.right):
        if len(edge.points_mm) < 3:
            return float("nan")
        end = _end(edge.points_mm)
        points_mm = edge.points_mm[end]
        spread_mm2 = np.sum((points_mm - points_mm.mean(axis=0)) ** 2)
        # The variance of the slope of a line is divided by 4, because the direction is the mean of two lines.
        variance += np.mean(edge.sigma_mm[end] ** 2) / spread_mm2 / 4
    return float(np.degrees(np.sqrt(variance)))


def _end_direction(points_mm: Array) -> Array:
    """Return the unit vector along the last tenth of an edge; NaN for fewer than three points."""
    if len(points_mm) < 3:
        return np.full(2, np.nan)
    end = points_mm[_end(points_mm)]
    axis = np.linalg.svd(end - end.mean(axis=0), full_matrices=False)[2][0]
    return np.asarray(axis if axis @ (end[-1] - end[0]) > 0 else -axis)


def _end(points_mm: Array) -> NDArray[np.bool_]:
    """Return True for each point in the last tenth of an edge, and for its last three points."""
    steps = np.hypot(*np.diff(points_mm, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(along >= min(along[-1] * (1.0 - END_SHARE), along[-3]))
