"""Estimate how the back-light changes across an edge, from the light beside the beam."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.edges.profiles import read_profiles

Array = NDArray[np.float64]

_REACH_PX = 16.0  # beyond the outer end of a profile
_NEIGHBOURS = 10  # on each side, that share one slope of the light
_STEEPEST_PER_PX = 0.01  # of the light; a larger slope is another body


def light_along(
    image: NDArray[Any], points_px: Array, normals: Array, stations_px: Array, counts: Sequence[int]
) -> Array:
    """Return the back-light along lines across the edges, divided by the back-light at the edge.

    Parameters
    ----------
    image : ndarray, shape (rows, columns)
        Grey values with a dark beam.
    points_px, normals : ndarray, shape (n, k, 2)
        Origins and unit directions of k parallel lines at each of n places. Their grey values are averaged.
    stations_px : ndarray, shape (m,)
        Distances along the lines.
    counts : sequence of int
        Number of places on each edge; the places of the first edge come first.

    Returns
    -------
    ndarray, shape (n, m)
        The relative back-light at the m distances, for each place.
    """
    stations_beyond = stations_px[-1] + np.arange(_REACH_PX + 1.0)
    beyond, inside = read_profiles(image, points_px, normals, stations_beyond)
    middle = float(stations_beyond.mean())
    level = beyond.mean(axis=1)
    rise = (beyond - level[:, None]) @ (stations_beyond - middle) / ((stations_beyond - middle) ** 2).sum()
    slope = rise / np.maximum(level, 1e-9)
    is_light = inside & (np.abs(slope) < _STEEPEST_PER_PX)
    slope = np.where(is_light, slope, np.nan)
    common = np.zeros(len(slope))
    begin = 0
    for count in counts:
        padded = np.pad(slope[begin : begin + count], _NEIGHBOURS, constant_values=np.nan)
        neighbours = np.lib.stride_tricks.sliding_window_view(padded, 2 * _NEIGHBOURS + 1)
        measured = np.isfinite(neighbours).any(axis=1)
        common[begin : begin + count][measured] = np.nanmedian(neighbours[measured], axis=1)
        begin += count
    at_edge = 1.0 - common * middle
    return 1.0 + (common / at_edge)[:, None] * stations_px
