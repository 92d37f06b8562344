"""Measure width, length and twist of the beam from its edges, and compare them with the specimen."""

from __future__ import annotations

import math

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

_BENDING_DEGREE = 5  # of the polynomial for the direction of an edge


def local_widths(left: Array, right: Array) -> Array:
    """Return the distance of each point of the left edge from the right edge.

    For each left point, the nearest point of the right edge is determined. The distance is measured to the straight
    line through the two neighbours of this nearest point.

    Parameters
    ----------
    left, right : ndarray, shape (n, 2) and (m, 2)
        Points of the left edge (n points) and of the right edge (m points), ordered from the clamp, in any one unit.

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
    """Return, at each point of the left edge, how much wider a bent beam can look because its cross-section bows.

    A bent beam also curves across its depth (anticlastic bending). With the bending curvature k and an incompressible
    material, this second curvature is k / 2. Over the depth it makes the outline wider by k depth² / 16. The increase
    is limited to a sixth of the width, because a deep strip stays flat in the middle of its depth (Ashwell 1950,
    J. R. Aeronaut. Soc. 54:708). Near the clamp and near the magnet the true increase is smaller than the result.

    Parameters
    ----------
    left, right : ndarray, shape (n, 2) and (m, 2)
        Points of the left edge (n points) and of the right edge (m points), ordered from the clamp.
    width, depth : float
        Width and depth of the specimen, in the unit of the points.

    Returns
    -------
    ndarray, shape (n,)
        Largest increase of the width at each point of the left edge, in the unit of the points.
    """
    along = np.linspace(0.0, 1.0, len(left))
    curvature = 0.5 * (_curvature(left, along) + _curvature(right, along))
    return np.asarray(np.minimum(np.abs(curvature) * depth**2 / 16.0, width / 6.0))


def _curvature(edge: Array, along: Array) -> Array:
    """Return the smoothed curvature of an edge, shape (m,), at m points of the edge.

    edge: n points, shape (n, 2). along: distance of the m points from the clamp along the edge, divided by the length
    of the edge, shape (m,).
    """
    steps = np.diff(edge, axis=0)
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*steps.T))])
    direction = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    middles = 0.5 * (arc[1:] + arc[:-1])
    smooth = np.polynomial.Polynomial.fit(middles, direction, min(_BENDING_DEGREE, len(middles) - 1))
    return np.asarray(smooth.deriv()(along * arc[-1]))


def width_deviation(widths: Array, width: float, bow: Array | float = 0.0) -> float:
    """Return how much n measured local widths of the beam differ from the specimen's width, as a fraction.

    The result is the 90th percentile of |local width - specimen's width| / specimen's width. A bent beam can look wider
    than it is, because its cross-section bows. `bow`, shape (n,), is the largest width that this can add. An excess of
    the local width is therefore ignored up to this amount.
    """
    excess = widths - width
    return float(np.percentile(np.abs(excess - np.clip(excess, 0.0, bow)) / width, 90))


def length_deviation(left: Array, right: Array, corners: Array, length: float) -> float:
    """Return the relative difference between the mean length of the two edges and the length of the specimen.

    Parameters
    ----------
    left, right : ndarray, shape (n, 2) and (m, 2)
        Points of the left edge (n points) and of the right edge (m points), ordered from the clamp.
    corners : ndarray, shape (4, 2)
        Clamp-left, clamp-right, tip-left, tip-right. Each edge is measured from its corner at the clamp to its corner
        at the tip.
    length : float
        Length of the specimen, in the unit of the points.
    """
    total = 0.0
    for points, start, end in ((left, corners[0], corners[2]), (right, corners[1], corners[3])):
        total += float(np.hypot(*np.diff(np.vstack([start, points, end]), axis=0).T).sum())
    return abs(0.5 * total / length - 1.0)


def twist_deg(widths: Array, width: float, depth: float) -> float:
    """Return the angle (degrees) by which the tip is turned about the beam's axis relative to the clamp.

    A box of width w and depth d that is turned by φ about its axis has the apparent width w cos φ + d sin φ. A twisted
    beam therefore looks wider at its tip. The angle φ is computed from the median width of the last quarter of the
    beam, compared with the median width of its first eighth. If the first eighth is narrower than the specimen, because
    the weight stretches the beam there, the comparison is made with the width of the specimen.

    The middles of the first eighth and of the last quarter are 13/16 of the length apart. A twist that grows evenly
    from the clamp to the tip is therefore 16/13 φ, which is the result.

    Parameters
    ----------
    widths : ndarray, shape (n,)
        Widths of the beam at n places from the clamp to the tip.
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
    """Return the angle (degrees) by which the beam must be turned about its axis to have the measured median width.

    The result is 0 if the median of `widths` is not larger than `width`, the width of the specimen.
    """
    apparent = float(np.median(widths))
    return _turn_deg(apparent, width, depth) if apparent > width else 0.0


def _turn_deg(apparent: float, width: float, depth: float) -> float:
    """Return the angle φ (degrees) by which a box must be turned about its axis to look as wide as `apparent`.

    The turned box looks as wide as width · cos φ + depth · sin φ.
    """
    # w cos(phi) + d sin(phi) = R sin(phi + beta), tan(beta) = w / d
    beta, radius = math.atan2(width, depth), math.hypot(width, depth)
    return math.degrees(math.asin(min(1.0, apparent / radius)) - beta)


def stiffening_by_twist(root_deg: float, tip_deg: float, width: float, depth: float) -> float:
    """Return by which fraction a twist makes a box stiffer against bending in the plane of the image.

    A fit that assumes no twist identifies a modulus that is too large by this fraction. The fraction is negative for a
    beam that is less deep than wide.

    In a section that is turned by φ about the axis of the box, a bending moment M in the plane of the image causes the
    curvature M/E · (cos² φ / I1 + sin² φ / I2) in this plane. E is Young's modulus; I1 and I2 are the second moments of
    area about the two principal axes, with I1/I2 = (width/depth)². For small angles, sin² φ is replaced by φ². The mean
    of φ² between the root and the tip, for an angle that grows evenly, is m. The returned fraction is

        1 / (1 - m (1 - (width/depth)²)) - 1,    m = (root² + root · tip + tip²) / 3,

    with the angles of root and tip in radians.

    Parameters
    ----------
    root_deg, tip_deg : float
        Turn of the section at the root and at the tip.
    width, depth : float
        Width and depth of the specimen.

    Examples
    --------
    >>> round(stiffening_by_twist(0.0, 2.0, width=3.0, depth=5.0), 5)
    0.00026
    """
    root, tip = math.radians(root_deg), math.radians(tip_deg)
    mean_square = (root * root + root * tip + tip * tip) / 3.0
    return 1.0 / (1.0 - mean_square * (1.0 - (width / depth) ** 2)) - 1.0
