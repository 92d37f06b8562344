"""What a tracking tool's file says, whatever the tool: points in frames, in its own unit and axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Tracks:
    """n points in k frames.

    frames: (k,) the numbers by which the tool calls its frames. places: (k, n, 2), or (k, n, 3), NaN where a point is
    not seen. rest: (n, 2) places in the reference picture, where the tool has one. sigma: (k, n) standard deviation of
    a place. unit: px, mm, cm, m or in. times_s: (k,). All of these None where the file does not tell. image_axes:
    whether places are pixels of the picture as this suite counts them: the first one's centre is 0, 0, and y is down.
    """

    names: tuple[str, ...]
    frames: NDArray[np.int64]
    places: Array
    rest: Array | None = None
    sigma: Array | None = None
    unit: str | None = None
    times_s: Array | None = None
    image_axes: bool = False
