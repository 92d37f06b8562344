"""Measure width, length and twist of the beam from its edges."""

from __future__ import annotations

import math

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

_BENDING_DEGREE = 5  # of the polynomial for the direction of an edge


def local_widths(left: Array, right: Array) -> Array:
    """Return the distance of each point of the left edge from the right edge.

    Parameters
    ----------
    left, right : ndarray, shape (n, 2) and (m, 2)
        Points of the two edges, ordered from the clamp.

    Returns
    -------
    ndarray, shape (n,)
        Distances in the unit of the points.
    """
    nearest = scipy.spatial.cKDTree(right).query(left)[1]
    # The points are far apart, so that the distance to the nearest point itself would be too large.
    behind, ahead = right[np.maximum(nearest - 1, 0)], right[np.minimum(nearest + 1, len(right) - 1)]
    chord = (ahead - behind) / np.linalg.norm(ahead - behind, axis=1, keepdims=True)
    gap = left - right[nearest]
    return np.asarray(np.abs(chord[:, 0] * gap[:, 1] - chord[:, 1] * gap[:, 0]))


def anticlastic_bow(left: Array, right: Array, width: float, depth: float) -> Array:
    """Return how much wider a bent beam can look because its cross-section bows (anticlastic bending).

    Parameters
    ----------
    left, right : ndarray, shape (n, 2) and (m, 2)
        Points of the two edges, ordered from the clamp.
    width, depth : float
        Width and depth of the specimen, in the unit of the points.

    Returns
    -------
    ndarray, shape (n,)
        Largest increase of the width at each point of the left edge.
    """
    along = np.linspace(0.0, 1.0, len(left))
    curvature = 0.5 * (_curvature(left, along) + _curvature(right, along))
    # An incompressible section curves by half of the bending curvature. A deep strip stays flat in the middle of its
    # depth (Ashwell 1950, J. R. Aeronaut. Soc. 54:708), hence the limit.
    return np.asarray(np.minimum(np.abs(curvature) * depth**2 / 16.0, width / 6.0))


def _curvature(edge: Array, along: Array) -> Array:
    steps = np.diff(edge, axis=0)
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*steps.T))])
    direction = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    middles = 0.5 * (arc[1:] + arc[:-1])
    smooth = np.polynomial.Polynomial.fit(middles, direction, min(_BENDING_DEGREE, len(middles) - 1))
    return np.asarray(smooth.deriv()(along * arc[-1]))


def width_deviation(widths: Array, width: float, bow: Array | float = 0.0) -> float:
    """Return the 90th percentile of the relative difference between measured widths and the specimen's width.

    An increase of the width by bending, at most `bow`, is not counted.
    """
    excess = widths - width
    return float(np.percentile(np.abs(excess - np.clip(excess, 0.0, bow)) / width, 90))


def length_deviation(left: Array, right: Array, corners: Array, length: float) -> float:
    """Return the relative difference between the mean length of both edges and the specimen's length.

    Parameters
    ----------
    left, right : ndarray, shape (n, 2) and (m, 2)
        Points of the two edges, ordered from the clamp.
    corners : ndarray, shape (4, 2)
        Clamp-left, clamp-right, tip-left, tip-right.
    length : float
        Length of the specimen, in the unit of the points.
    """
    total = 0.0
    for points, start, end in ((left, corners[0], corners[2]), (right, corners[1], corners[3])):
        total += float(np.hypot(*np.diff(np.vstack([start, points, end]), axis=0).T).sum())
    return abs(0.5 * total / length - 1.0)


def twist_deg(widths: Array, width: float, depth: float) -> float:
    """Return the twist of the beam from clamp to tip (degrees), judged by its widths.

    Parameters
    ----------
    widths : ndarray, shape (n,)
        Apparent widths of the beam from the clamp to the tip.
    width, depth : float
        Width and depth of the specimen, in the unit of the widths.
    """
    root, tip = widths[: max(1, len(widths) // 8)], widths[-max(1, len(widths) // 4) :]
    reference = max(width, float(np.median(root)))
    excess = (float(np.median(tip)) - reference) * width / reference
    if excess <= 0.0:
        return 0.0
    # The middles of the two stretches are at 1/16 and 7/8 of the length.
    return _turn_deg(width + excess, width, depth) / (7.0 / 8.0 - 1.0 / 16.0)


def even_turn_deg(widths: Array, width: float, depth: float) -> float:
    """Return the rotation of the beam about its axis (degrees) that explains its apparent widths."""
    apparent = float(np.median(widths))
    return _turn_deg(apparent, width, depth) if apparent > width else 0.0


def _turn_deg(apparent: float, width: float, depth: float) -> float:
    # w cos(phi) + d sin(phi) = R sin(phi + beta), tan(beta) = w / d
    beta, radius = math.atan2(width, depth), math.hypot(width, depth)
    return math.degrees(math.asin(min(1.0, apparent / radius)) - beta)


def stiffening_by_twist(root_deg: float, tip_deg: float, width: float, depth: float) -> float:
    """Return by which fraction a twist makes a box stiffer against bending in the plane of the image.

    Parameters
    ----------
    root_deg, tip_deg : float
        Rotations of the sections at the clamp and at the tip about the axis of the box.
    width, depth : float
        Width and depth of the box, in any unit.

    Examples
    --------
    >>> round(stiffening_by_twist(0.0, 2.0, width=3.0, depth=5.0), 5)
    0.00026
    """
    # With the turn phi of a section, the curvature is M / E (cos(phi)^2 / I1 + sin(phi)^2 / I2), I1 / I2 = (w / d)^2.
    root, tip = math.radians(root_deg), math.radians(tip_deg)
    mean_square = (root * root + root * tip + tip * tip) / 3.0
    return 1.0 / (1.0 - mean_square * (1.0 - (width / depth) ** 2)) - 1.0
