"""How the back-light changes along the profiles of an edge, read beside the beam."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.edges.profiles import read_profiles

Array = NDArray[np.float64]

_REACH_PX = 16.0  # beyond a profile's outer end
_NEIGHBOURS = 10  # on each side, whose light is taken for one
_STEEPEST_PER_PX = 0.01  # of the light; what changes faster is another body


def light_along(
    image: NDArray[Any], points_px: Array, normals: Array, stations_px: Array, counts: Sequence[int]
) -> Array:
    """Light (n, m) at the stations of n profiles as a share of that at their edge; what passes the beam has it too.

    points_px, normals: (n, k, 2), as `read_profiles` has them. stations_px: (m,). counts: how many of the profiles
    belong to each edge in turn. A slope over the few pixels of a profile, which a wider or narrower second step would
    imitate, is that of the light 16 px beyond it: the median of 21 neighbours, so that dirt there does not count.
    """
    places = stations_px[-1] + np.arange(_REACH_PX + 1.0)
    beyond, inside = read_profiles(image, points_px, normals, places)
    middle = float(places.mean())
    level = beyond.mean(axis=1)
    rise = (beyond - level[:, None]) @ (places - middle) / ((places - middle) ** 2).sum()
    slope = rise / np.maximum(level, 1e-9)
    seen = inside & (np.abs(slope) < _STEEPEST_PER_PX)
    slope = np.where(seen, slope, np.nan)
    common = np.zeros(len(slope))
    begin = 0
    for count in counts:
        padded = np.pad(slope[begin : begin + count], _NEIGHBOURS, constant_values=np.nan)
        near = np.lib.stride_tricks.sliding_window_view(padded, 2 * _NEIGHBOURS + 1)
        known = np.isfinite(near).any(axis=1)
        common[begin : begin + count][known] = np.nanmedian(near[known], axis=1)
        begin += count
    at_edge = 1.0 - common * middle
    return 1.0 + (common / at_edge)[:, None] * stations_px
