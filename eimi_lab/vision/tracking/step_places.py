"""Measure the positions of edges from the area under profiles of grey values, independently of the blur.

A frame of a moving beam is blurred by the lens and by the motion during the exposure. For any blur, the area under a
blurred step from 0 to 1 is the distance from the mean position of the step to the end of the profile. If the speed is
constant during the exposure, the mean position is the position at the middle of the exposure.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_END_SHARE = 6  # the plateaus are means over this part of a profile, at each end


class StepPlaces(NamedTuple):
    """The steps of the grey value, one on each of n profiles across an edge.

    Attributes
    ----------
    offset_px : ndarray, shape (n,)
        Position of each step, in the coordinate along the profile.
    height : ndarray, shape (n,)
        Grey value at the outer end minus grey value at the inner end of each profile.
    """

    offset_px: Array
    height: Array


def step_places(stations_px: Array, profiles: Array) -> StepPlaces:
    """Return the position and the height of one step on each of n profiles of grey values.

    Parameters
    ----------
    stations_px : ndarray, shape (m,)
        The m evenly spaced coordinates along the profiles, increasing outward.
    profiles : ndarray, shape (n, m)
        Grey values of the n profiles.

    Returns
    -------
    StepPlaces
        The position and the height of each step.

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
    """Find the beam on each of n profiles: where a band as wide as the beam differs most from its surroundings.

    A profile contains the grey values along a line across the beam. The band is an interval of the profile that is as
    wide as the beam. It is shifted along the profile to the place where its mean grey value differs most from the mean
    grey values beside it.

    Parameters
    ----------
    profiles : ndarray, shape (n, m)
        Grey values at m pixels across the beam, for n profiles.
    stations_px : ndarray, shape (m,)
        Coordinates along the profiles, one pixel apart.
    half_px : ndarray, shape (n,)
        Half of the width of the band on each profile.
    reach_px : ndarray, shape (n,)
        Largest permitted shift on each profile.
    polarity : float
        +1 for a dark band, -1 for a bright band.

    Returns
    -------
    shift_px : ndarray, shape (n,)
        Shift of the middle of the band from the coordinate 0.
    contrast : ndarray, shape (n,)
        The smaller of the two differences in mean grey value between the band and the regions on its two sides.
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
