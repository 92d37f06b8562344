"""Tracked points in frames, in the unit and axes of the file of any tracking program."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Tracks:
    """Positions of n points in k frames; a value that the file does not state is None.

    Parameters
    ----------
    names
        Names of the points.
    frames
        (k,) numbers of the frames, as the program counts them.
    places
        (k, n, 2) or (k, n, 3) positions; NaN where a point was not seen.
    rest
        (n, 2) positions in the reference picture.
    sigma
        (k, n) standard deviation of each coordinate.
    unit
        Unit of positions: px, mm, cm, m or in.
    times_s
        (k,) times of the frames.
    image_axes
        Whether positions are pixels as this suite counts them: the centre of the first pixel is 0, 0, and y is down.
    """

    names: tuple[str, ...]
    frames: NDArray[np.int64]
    places: Array
    rest: Array | None = None
    sigma: Array | None = None
    unit: str | None = None
    times_s: Array | None = None
    image_axes: bool = False
