"""Positions of tracked points, in the unit and axes of the file that a tracking program wrote."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Tracks:
    """Positions of n tracked points in k frames, in the unit and axes of their file; None for a value not in the file.

    Parameters
    ----------
    names
        Names of the points.
    frames
        Frame numbers of the tracking program, shape (k,).
    places
        Positions in each frame, shape (k, n, 2) or (k, n, 3); NaN for a point that was not found.
    rest
        Positions in the reference picture, shape (n, 2).
    sigma
        Standard deviation of one coordinate, shape (k, n).
    unit
        Unit of the positions: px, mm, cm, m or in.
    times_s
        Times of the frames, s, shape (k,).
    image_axes
        Whether positions are pixels from the centre of the first pixel, with y down.
    """

    names: tuple[str, ...]
    frames: NDArray[np.int64]
    places: Array
    rest: Array | None = None
    sigma: Array | None = None
    unit: str | None = None
    times_s: Array | None = None
    image_axes: bool = False
