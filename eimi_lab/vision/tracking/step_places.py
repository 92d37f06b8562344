"""Measure the positions of blurred edges from the area under grey values across the edges.

For a blurred step from 0 to 1, this area is the distance from the step's mean position to the end of the line.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_END_SHARE = 6  # the plateaus are means over this part of a profile, at each end


class StepPlaces(NamedTuple):
    """Positions and heights of edges on n lines across them.

    Attributes
    ----------
    offset_px : ndarray, shape (n,)
        Position of the edge along each line.
    height : ndarray, shape (n,)
        Grey value at the outer end minus grey value at the inner end.
    """

    offset_px: Array
    height: Array


def step_places(stations_px: Array, profiles: Array) -> StepPlaces:
    """Return the position and the height of one step of grey value on each of n lines.

    Parameters
    ----------
    stations_px : ndarray, shape (m,)
        Evenly spaced coordinates along the lines, increasing outward.
    profiles : ndarray, shape (n, m)
        Grey values along the lines.

    Returns
    -------
    StepPlaces
        Positions and heights.

    Examples
    --------
    >>> u = np.linspace(-5.0, 5.0, 41)
    >>> ramp = np.clip(0.5 + (u - 0.7) / 4.0, 0.0, 1.0)  # a step at 0.7, smeared over 4 px
    >>> step_places(u, 20.0 + 100.0 * ramp[None]).offset_px.round(2).tolist()
    [0.7]
    """
    ends = max(2, len(stations_px) // _END_SHARE)
    inner, outer = profiles[:, :ends].mean(axis=1), profiles[:, -ends:].mean(axis=1)
    height = outer - inner
    share = (profiles - inner[:, None]) / np.where(np.abs(height) > 1e-9, height, 1.0)[:, None]
    area = (share.sum(axis=1) - 0.5 * (share[:, 0] + share[:, -1])) * (stations_px[1] - stations_px[0])
    return StepPlaces(stations_px[-1] - area, height)


def band_shifts(
    profiles: Array, stations_px: Array, half_px: Array, reach_px: Array, polarity: float
) -> tuple[Array, Array]:
    """Find the beam on n lines across it, where an interval as wide as the beam differs most from both sides.

    Parameters
    ----------
    profiles : ndarray, shape (n, m)
        Grey values at m pixels along each line.
    stations_px : ndarray, shape (m,)
        Coordinates along the lines, one pixel apart.
    half_px : ndarray, shape (n,)
        Half of the beam's width.
    reach_px : ndarray, shape (n,)
        Largest permitted shift of the interval from coordinate 0.
    polarity : float
        +1 for a dark beam, -1 for a bright beam.

    Returns
    -------
    shift_px : ndarray, shape (n,)
        Shift of the middle of the interval from coordinate 0.
    contrast : ndarray, shape (n,)
        Difference in mean grey value between interval and surroundings, on the side where it is smaller.
    """
    total = np.concatenate([np.zeros((len(profiles), 1)), np.cumsum(polarity * profiles, axis=1)], axis=1)
    first = stations_px[0] - 0.5
    last = profiles.shape[1]
    most = int(np.ceil(reach_px.max()))
    shifts = np.arange(-most, most + 1, dtype=float)
    rows = np.arange(len(profiles))[:, None]

    def mean(low: Array, high: Array) -> Array:
        begin = np.clip(np.rint(low - first), 0, last - 1).astype(int)
        end = np.clip(np.maximum(np.rint(high - first).astype(int), begin + 1), 1, last)
        return np.asarray((total[rows, end] - total[rows, begin]) / (end - begin))

    half = half_px[:, None]
    beside = np.maximum(4.0, 0.35 * half)
    inside = mean(shifts - 0.8 * half, shifts + 0.8 * half)
    left = mean(shifts - half - beside, shifts - half - 1.0)
    right = mean(shifts + half + 1.0, shifts + half + beside)
    contrast = np.minimum(left, right) - inside
    contrast = np.where(np.abs(shifts) <= reach_px[:, None], contrast, -np.inf)
    best = contrast.argmax(axis=1)
    return shifts[best], contrast[np.arange(len(profiles)), best]
