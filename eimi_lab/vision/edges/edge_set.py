"""What segmentation says of one state: two edges in millimetres and the reasons to distrust them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.check import Flag

Array = NDArray[np.float64]


@dataclass(frozen=True)
class EdgePoints:
    """One edge, ordered from the clamp to the tip, in the beam frame.

    points_mm: (n, 2); sigma_mm: (n,) standard deviation along the edge's normal.
    """

    points_mm: Array
    sigma_mm: Array


@dataclass(frozen=True)
class EdgeSet:
    """Both edges of one state (left: y < 0 at zero field), the frame's flags, and the corners in pixels.

    corners_px: (4, 2) clamp-left, clamp-right, tip-left, tip-right; NaN where a corner was not found.
    An edge set without points (n = 0) is a frame in which no beam was found; its flags say why.
    calibration_digest: `Calibration.digest` of the one that made pixels millimetres; calibration_age_days: how old it
    was when the frame was taken, None where that is not known.
    """

    left: EdgePoints
    right: EdgePoints
    flags: tuple[Flag, ...]
    corners_px: Array
    calibration_digest: str = ""
    calibration_age_days: float | None = None

    @property
    def middle_mm(self) -> Array:
        """(n, 2) amid the left edge's points and the right edge's nearest to each; empty without points."""
        left, right = self.left.points_mm, self.right.points_mm
        if not (len(left) and len(right)):
            return np.zeros((0, 2))
        nearest = ((left[:, None] - right) ** 2).sum(axis=2).argmin(axis=1)
        return np.asarray(0.5 * (left + right[nearest]))


END_SHARE = 0.1
"""Of an edge's length: what of its end tells where the tip points."""


def tip_angle_deg(found: EdgeSet) -> float:
    """Where the tip points, from +x toward +y: the mean direction of the last tenth of both edges; NaN without edges.

    A few pixels at the tip's own corners are no part of the edges, so that this is the direction just before them.
    """
    directions = [_end_direction(edge.points_mm) for edge in (found.left, found.right)]
    x, y = np.sum(directions, axis=0)
    return float(np.degrees(np.arctan2(y, x)))


def _end_direction(points_mm: Array) -> Array:
    """(2,) of length 1: the main axis of the end of an edge (n, 2), away from the clamp; NaN for too few points."""
    if len(points_mm) < 3:
        return np.full(2, np.nan)
    steps = np.hypot(*np.diff(points_mm, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    end = points_mm[along >= min(along[-1] * (1.0 - END_SHARE), along[-3])]
    axis = np.linalg.svd(end - end.mean(axis=0), full_matrices=False)[2][0]
    return np.asarray(axis if axis @ (end[-1] - end[0]) > 0 else -axis)
