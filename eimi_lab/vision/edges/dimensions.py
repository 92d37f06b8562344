"""The beam's width, length and twist as its edges show them, against what the specimen's file says."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Array = NDArray[np.float64]


def local_widths(left: Array, right: Array) -> Array:
    """(n,) distances of the left edge's points (n, 2) from the right edge (m, 2), both ordered from the clamp."""
    nearest = cKDTree(right).query(left)[1]
    # The neighbours' chord, not the nearest point itself: the points are far apart for what is asked here.
    behind, ahead = right[np.maximum(nearest - 1, 0)], right[np.minimum(nearest + 1, len(right) - 1)]
    chord = (ahead - behind) / np.linalg.norm(ahead - behind, axis=1, keepdims=True)
    gap = left - right[nearest]
    return np.asarray(np.abs(chord[:, 0] * gap[:, 1] - chord[:, 1] * gap[:, 0]))


def width_deviation(widths: Array, width: float) -> float:
    """Departure of the local width from the specimen's, as a share of it; a tenth of the beam departs more."""
    return float(np.percentile(np.abs(widths / width - 1.0), 90))


def length_deviation(left: Array, right: Array, corners: Array, length: float) -> float:
    """Departure of both edges' mean length, corner to corner (4, 2), from the specimen's, as a share of it."""
    total = 0.0
    for points, start, end in ((left, corners[0], corners[2]), (right, corners[1], corners[3])):
        total += float(np.hypot(*np.diff(np.vstack([start, points, end]), axis=0).T).sum())
    return abs(0.5 * total / length - 1.0)


def twist_deg(widths: Array, width: float, depth: float) -> float:
    """By how much the tip is turned about the beam's own axis against the clamp, which holds the root.

    A box turned by phi shows the width w cos(phi) + depth sin(phi). What counts is the excess of the last quarter
    over the first eighth and over the specimen's own width: a beam that its weight stretches is narrow at the root.
    """
    root, tip = widths[: max(1, len(widths) // 8)], widths[-max(1, len(widths) // 4) :]
    reference = max(width, float(np.median(root)))
    excess = (float(np.median(tip)) - reference) * width / reference
    if excess <= 0.0:
        return 0.0
    # The two stretches' middles are at 1/16 and 7/8 of the beam, over whose whole length a steady twist is asked for.
    return _turn_deg(width + excess, width, depth) / (7.0 / 8.0 - 1.0 / 16.0)


def even_turn_deg(widths: Array, width: float, depth: float) -> float:
    """By how much the whole beam would have to be turned about its axis to look as wide as it does; 0 if narrower."""
    seen = float(np.median(widths))
    return _turn_deg(seen, width, depth) if seen > width else 0.0


def _turn_deg(seen: float, width: float, depth: float) -> float:
    # w cos(phi) + d sin(phi) = R sin(phi + beta), tan(beta) = w / d
    beta, radius = math.atan2(width, depth), math.hypot(width, depth)
    return math.degrees(math.asin(min(1.0, seen / radius)) - beta)


def stiffening_by_twist(root_deg: float, tip_deg: float, width: float, depth: float) -> float:
    """By which share a twisted box resists bending in the image's plane more than a straight one.

    The bending moment splits over the section's two axes: the curvature in the plane is M/E (cos²/I1 + sin²/I2) with
    I1/I2 = (width/depth)², averaged over a turn that grows evenly from the root to the tip. A fit that knows of no
    twist finds the modulus too high by this share (too low for a beam that is less deep than wide).
    """
    root, tip = math.radians(root_deg), math.radians(tip_deg)
    mean_square = (root * root + root * tip + tip * tip) / 3.0
    return 1.0 / (1.0 - mean_square * (1.0 - (width / depth) ** 2)) - 1.0
