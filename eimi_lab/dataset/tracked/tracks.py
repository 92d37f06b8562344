"""Positions of tracked points, in the unit and axes of the file that a tracking program wrote."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Tracks:
    """Positions of n tracked points in k frames, in the unit and axes of the file.

    An attribute is None if the file does not contain its value.

    Parameters
    ----------
    names
        Names of the points.
    frames
        Numbers of the frames, as the tracking program counts frames, shape (k,).
    places
        Positions of the points in each frame, shape (k, n, 2) or (k, n, 3); NaN for a point that was not seen in a
        frame.
    rest
        Positions of the points in the reference picture, shape (n, 2).
    sigma
        Standard deviation of one coordinate of each point in each frame, shape (k, n).
    unit
        Unit of the positions: px, mm, cm, m or in.
    times_s
        Times of the frames in s, shape (k,).
    image_axes
        Whether positions are pixels in the axes of a calibration: the centre of the first pixel is 0, 0, and y points
        down.
    """

    names: tuple[str, ...]
    frames: NDArray[np.int64]
    places: Array
    rest: Array | None = None
    sigma: Array | None = None
    unit: str | None = None
    times_s: Array | None = None
    image_axes: bool = False
