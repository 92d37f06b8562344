"""Find an edge of the beam by dynamic programming, as the line across which the colour changes most."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

ARM = 0.12  # widths: the fall is the difference of the means over this length on both sides
CHROMA_ARM = 2.0 * ARM  # cameras and JPEG store the hue with half of the resolution of the brightness
_ALONG = 0.35  # widths along the beam over which the fall is averaged
_STEEPEST = 2  # largest number of places by which a seam moves from station to station
_UNREST = 0.05  # cost of each place, where a full step has a fall of 1
_PRIOR = 0.25  # cost of a seam at one standard deviation from its expected place


def fall_across(
    share: Array, outward: float, across: Array, stations_in_width: float, arm_widths: float = ARM
) -> Array:
    """Return, for each pixel, the mean of `share` on the inner side minus the mean on the outer side.

    Parameters
    ----------
    share : ndarray, shape (n, m)
        Weighted sum of the colours, 1 inside the beam and 0 outside, in the straightened picture of the beam.
    outward : float
        -1 for the left edge, +1 for the right edge.
    across : ndarray, shape (m,)
        Coordinates of the columns across the beam, in widths of the beam.
    stations_in_width : float
        Number of rows on a length of one width of the beam.
    arm_widths : float
        Length of each mean across the beam, in widths of the beam.

    Returns
    -------
    ndarray, shape (n, m)
        The differences, averaged over a few rows; 1 at an ideal edge.
    """
    arm = max(2, round(arm_widths / (across[1] - across[0])))
    padded = np.pad(share, ((0, 0), (arm, arm)), mode="edge")
    total = np.cumsum(np.pad(padded, ((0, 0), (1, 0))), axis=1)
    mean = (total[:, arm:] - total[:, :-arm]) / arm  # of padded[i : i + arm]
    places = share.shape[1]
    lower, upper = mean[:, :places], mean[:, arm + 1 : arm + 1 + places]
    window = max(1, round(_ALONG * stations_in_width))
    return scipy.ndimage.uniform_filter1d(outward * (lower - upper), window, axis=0, mode="nearest")


def find_seams(fall: Array, across: Array, expected: Array, tolerance: float) -> Array:
    """Return the positions of k edges of the beam: the lines across which the colour changes most, shape (k, n).

    Parameters
    ----------
    fall : ndarray, shape (k, n, m)
        Change of colour in the n rows and m columns of the straightened picture of the beam.
    across : ndarray, shape (m,)
        Coordinates of the columns across the beam, in widths of the beam.
    expected : ndarray, shape (k, n)
        Expected positions of the edges, in widths of the beam.
    tolerance : float
        Standard deviation about the expected positions, in widths of the beam; an edge far away needs a larger fall.
    """
    value = fall - _PRIOR * ((across - expected[..., None]) / tolerance) ** 2
    count, stations, places = value.shape
    # dynamic programming: the line with the largest sum of values, less a cost for moves across the beam
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
        predecessors = index[:, seams[:, station]]
        seams[:, station - 1] = predecessors[(best[station - 1][rows, predecessors] - cost).argmax(axis=0), rows]
    return np.stack([_refined_positions(values, seam, across) for values, seam in zip(value, seams, strict=True)])


def _refined_positions(value: Array, seam: NDArray[np.int64], across: Array) -> Array:
    at = np.clip(seam, 1, len(across) - 2)
    rows = np.arange(len(seam))
    before, here, after = (value[rows, at + shift] for shift in (-1, 0, 1))
    bend = np.minimum(before - 2.0 * here + after, -1e-9)
    shift = np.clip(0.5 * (before - after) / bend, -0.5, 0.5)
    return np.asarray(across[at] + shift * (across[1] - across[0]))
