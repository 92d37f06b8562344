"""What segmentation says of one state: two edges in millimetres and the reasons to distrust them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class EdgePoints:
    """One edge, ordered from the clamp to the tip, in the beam frame.

    points_mm: (n, 2); sigma_mm: (n,) standard deviation along the edge's normal.
    """

    points_mm: Array
    sigma_mm: Array


@dataclass(frozen=True)
class Flag:
    """A quality check that a frame did not pass: the value found, the limit, and what to do about it."""

    name: str
    value: float
    limit: float
    remedy: str


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
