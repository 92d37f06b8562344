"""Move an edge inward, off the border of a shadow, if the beam looks wider than the specimen file states."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.following.colour_seams import OUTWARD, Seams, find_colour_seams
from eimi_lab.vision.following.shadows import is_dimmed, merged
from eimi_lab.vision.following.unrolled import UnrolledPicture

Array = NDArray[np.float64]

_WIDER = 0.15  # another edge is sought if the logarithm of (width / stated width) is at least this number
_AS_STATED = 0.1  # largest magnitude of this logarithm with the new edge: a width read by eye has about this error
_TOLERANCES = (0.3, 0.2)  # widths, of the two passes: about the place that the stated width gives, then about the seam
_LEAST_SUPPORT = 0.7  # mean of the other edge; a full step has the support 1
_LEAST_SEPARATION = 3.0  # median of the other edge, in standard deviations between inside and outside
_WINDOW = 1.0  # widths along the beam over which colours are averaged


def prefer_stated_width(unrolled: UnrolledPicture, seams: Seams, noise: float, end: int) -> Seams:
    """Move one edge inward, off a shadow, if the body between the edges is wider than the specimen file states.

    Parameters
    ----------
    unrolled : UnrolledPicture
        The straightened picture of the beam.
    seams : Seams
        Both edges.
    noise : float
        Standard deviation of the noise, grey levels (0 to 255).
    end : int
        Number of rows of the straightened picture before the end of the beam.

    Returns
    -------
    Seams
        The edges; `shadow` is the distance by which an edge was moved.
    """
    stated = unrolled.stated
    if _log_width(seams.edge / stated, end) < _WIDER:
        return seams
    best, best_support = seams, _LEAST_SUPPORT
    for row in (0, 1):
        expected = seams.edge.copy()
        expected[row] = expected[1 - row] + OUTWARD[row] * stated
        other = find_colour_seams(unrolled, expected, noise, _TOLERANCES)
        # The shadow may have the hue of the beam, and its border may be clearer than the edge: only the width shows the
        # error.
        support = float(other.support[row, :end].mean())
        separation = float(np.median(other.projected[row].separation[:end]))
        edge = seams.edge.copy()
        edge[row] = other.edge[row]
        inward = OUTWARD[row] * (seams.edge[row] - edge[row])
        window = max(3, round(_WINDOW * unrolled.stations_in_width))
        dark = is_dimmed(unrolled, edge[row], seams.edge[row], window)
        if (
            support > best_support
            and separation > _LEAST_SEPARATION
            and abs(_log_width(edge / stated, end)) < _AS_STATED
            and float(np.median(inward[:end])) > 0.0
            and float(dark[:end].mean()) > 0.5
        ):
            best, best_support = _with_edge(seams, other, row, inward), support
    return best


def _log_width(edge: Array, end: int) -> float:
    return float(np.log(max(np.median((edge[1] - edge[0])[:end]), 1e-3)))


def _with_edge(seams: Seams, other: Seams, row: int, inward: Array) -> Seams:
    moved = np.zeros(seams.edge.shape, dtype=bool)
    moved[row] = True
    left, right = (merged(*sides) for sides in zip(moved, other.projected, seams.projected, strict=True))
    return Seams(
        edge=np.where(moved, other.edge, seams.edge),
        support=np.where(moved, other.support, seams.support),
        projected=(left, right),
        shadow=np.where(moved, np.maximum(inward, 0.0), seams.shadow),
    )
