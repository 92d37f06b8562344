"""An edge as a seam of largest fall: dynamic programming along the unrolled beam."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

Array = NDArray[np.float64]

_ARM = 0.12  # widths: the fall is between the means of so much on both sides
_ALONG = 0.35  # widths that are averaged along the beam
_STEEPEST = 2  # places across by which a seam moves from station to station
_UNREST = 0.05  # cost of each, against a fall of 1
_PRIOR = 0.25  # cost of a seam one standard deviation from where it is expected


def fall_across(share: Array, outward: float, across: Array, stations_in_width: float) -> Array:
    """(n, m) by how much ``share`` falls outward at each place, 1 for a whole edge."""
    arm = max(2, round(_ARM / (across[1] - across[0])))
    padded = np.pad(share, ((0, 0), (arm, arm)), mode="edge")
    total = np.cumsum(np.pad(padded, ((0, 0), (1, 0))), axis=1)
    mean = (total[:, arm:] - total[:, :-arm]) / arm  # of padded[i : i + arm]
    places = share.shape[1]
    lower, upper = mean[:, :places], mean[:, arm + 1 : arm + 1 + places]
    window = max(1, round(_ALONG * stations_in_width))
    return uniform_filter1d(outward * (lower - upper), window, axis=0, mode="nearest")


def find_seams(fall: Array, across: Array, expected: Array, tolerance: float) -> Array:
    """(k, n) places across of the connected seams with the largest falls (k, n, m), k of them at a time.

    expected: (k, n), and its tolerance in widths.
    """
    value = fall - _PRIOR * ((across - expected[..., None]) / tolerance) ** 2
    count, stations, places = value.shape
    moves = np.arange(-_STEEPEST, _STEEPEST + 1)
    cost = (_UNREST * np.abs(moves))[:, None]
    index = np.clip(np.arange(places) + moves[:, None], 0, places - 1)
    best = np.empty((stations, count, places))
    best[0] = value[:, 0]
    for station in range(1, stations):
        np.add((best[station - 1][:, index] - cost).max(axis=1), value[:, station], out=best[station])
    seams = np.empty((count, stations), dtype=np.int64)
    seams[:, -1] = best[-1].argmax(axis=1)
    rows = np.arange(count)
    for station in range(stations - 1, 0, -1):
        came = index[:, seams[:, station]]
        seams[:, station - 1] = came[(best[station - 1][rows, came] - cost).argmax(axis=0), rows]
    return np.stack([_between(own, seam, across) for own, seam in zip(value, seams, strict=True)])


def _between(value: Array, seam: NDArray[np.int64], across: Array) -> Array:
    """The seam to a part of a place, by a parabola through its neighbours."""
    at = np.clip(seam, 1, len(across) - 2)
    rows = np.arange(len(seam))
    before, here, after = (value[rows, at + shift] for shift in (-1, 0, 1))
    bend = np.minimum(before - 2.0 * here + after, -1e-9)
    shift = np.clip(0.5 * (before - after) / bend, -0.5, 0.5)
    return np.asarray(across[at] + shift * (across[1] - across[0]))
