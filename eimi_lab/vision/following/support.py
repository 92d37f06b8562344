"""Decide at which places (stations) along the beam each edge is reliable ("sure"), and where the beam ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_opening, median_filter

from eimi_lab.vision.following.colour_seams import OUTWARD, find_colour_seams
from eimi_lab.vision.following.discriminant import ColourProjection
from eimi_lab.vision.following.shadows import move_off_shadows
from eimi_lab.vision.following.unrolled import UnrolledPicture

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

TOLERANCES = (0.3, 0.2, 0.2)  # widths, of the three passes: about the strip's edge, then about the seam before
_HALF = 0.5  # of the fall of a full step
_LEAST_SEPARATION = 3.0  # standard deviations between inside and outside
_ARM = 0.25  # widths on both sides of a station, over which the turn of an edge is measured
_SHARPEST = 0.5  # rad: a beam of the largest allowed curvature turns by 0.4; a larger turn is a shoulder
_LEVER = 1.5  # widths before a gap that determine the direction
_SHORTEST = 0.2  # widths: a shorter run of sure stations is rejected
_NOTCH = 0.25  # widths: a shorter gap of one edge, beside which the other edge is sure, is a notch in the same body
_NOTCH_LEAP = 0.15  # widths by which the width may differ behind a notch
_LEAP = 0.1  # widths by which the width may differ behind a gap
_ASIDE = 0.12  # widths by which an edge behind a gap may lie beside its straight continuation
_STRAY = 0.25  # widths that are added to both for each width of the gap
_LOCAL = 1.0  # widths: window of a running median of the edge
_OUTLIER = 0.08  # widths from the running median
_LONGEST_GAP = 0.1  # of the followed path: a beam does not change its bend over so short a stretch
_SURELY_BEAM = 0.9  # of the stated length, which is known to a tenth


@dataclass(frozen=True)
class Sides:
    """The left and the right edge of the beam at n stations (places) along the beam.

    The edges are given in the unrolled picture, which is sampled along and across the beam. The unit of length is the
    nominal width of the beam.

    Attributes
    ----------
    edge : ndarray, shape (2, n)
        Position of the left edge (row 0) and of the right edge (row 1) across the beam.
    support : ndarray, shape (2, n)
        Height of the step at the edge, from 0 to 1. A full step from the inside to the outside colour has the height 1.
    sound : ndarray of bool, shape (2, n)
        Whether each edge is reliable ("sure") at each station. True only if the step is clear, the edge is smooth, and
        the two sides of the edge differ in colour.
    end : int
        Number of stations before the end of the beam.
    projected : tuple of ColourProjection
        The colour projection (weighted sum of the colours) of each edge.
    shadow : ndarray, shape (2, n)
        Distance between an edge and the border of a possible shadow of the beam; 0 if no such border is found.
    """

    edge: Array
    support: Array
    sound: Mask
    end: int
    projected: tuple[ColourProjection, ColourProjection]
    shadow: Array

    @property
    def width(self) -> Array:
        """Width of the beam at each of n stations (places along the beam), in nominal widths, shape (n,)."""
        return np.asarray(self.edge[1] - self.edge[0])


def find_sides(unrolled: UnrolledPicture, noise: float, length: float, clicked: float = 0.0) -> Sides:
    """Find both edges of the beam in its unrolled picture, and the stations at which each edge is reliable.

    A station is a place along the beam, at which the picture is sampled across the beam.

    Parameters
    ----------
    unrolled : UnrolledPicture
        The picture, sampled along and across the beam.
    noise : float
        Standard deviation of the noise of a colour channel, in grey levels on a scale from 0 to 255.
    length : float
        Nominal length of the beam, in nominal widths.
    clicked : float
        Distance of the last point that a person clicked from the clamp, in nominal widths. The beam does not end before
        this point.

    Returns
    -------
    Sides
        Both edges, the stations at which each edge is reliable, and the end of the beam.
    """
    strip = np.outer(OUTWARD, 0.5 * unrolled.width)
    seams = move_off_shadows(unrolled, find_colour_seams(unrolled, strip, noise, TOLERANCES), noise)
    edge, support, projected = seams.edge, seams.support, seams.projected
    sound = _sound(unrolled, edge, support, projected)
    # The beam ends where the cumulative support of both sides, less 2 · _HALF at each station, is largest.
    total = np.cumsum(support.sum(axis=0) - 2.0 * _HALF)
    total[: np.searchsorted(unrolled.along[:-1], clicked)] = -np.inf
    sound[:, int(total.argmax()) + 1 :] = False
    scale = float(np.linalg.norm(unrolled.aside[0]))
    lever = round(_LEVER * unrolled.stations_in_width)
    for row in (0, 1):
        seam = unrolled.middle + edge[row][:, None] * unrolled.aside
        width = np.where(sound[1 - row], edge[1] - edge[0], np.nan)
        sound[row] = _longest_chain(seam, width, sound[row], scale, lever)
    end = _end(unrolled.along, sound, length)
    sound[:, end:] = False
    return Sides(edge, support, sound, end, projected, seams.shadow)


def sure_share(sound: Mask) -> dict[str, float]:
    """Return the share of the followed path on which an edge is reliable, with the key of the table of flags.

    The followed path leads from the clamp to the end of the search. The table of flags lists all quality checks. The
    smaller of the shares of the two edges is returned.

    Parameters
    ----------
    sound : ndarray of bool, shape (2, n)
        Whether each edge is reliable ("sure") at each of n stations (places along the beam).

    Returns
    -------
    dict of str to float
        The key is ``"followed_patches"`` if all gaps between sure stations are shorter than a tenth of the path. The
        path then follows the edge in spite of the gaps. Otherwise the key is ``"followed_sides"``.
    """
    worse = sound[int(sound.mean(axis=1).argmin())]
    boundaries = np.flatnonzero(np.concatenate([[True], worse, [True]]))
    spread = float(np.diff(boundaries).max() - 1) < _LONGEST_GAP * len(worse)
    return {"followed_patches" if spread else "followed_sides": float(worse.mean())}


def _end(along: Array, sound: Mask, length: float) -> int:
    """Return the number of stations (places along the beam) before the end of the beam.

    along: distance of each of n stations from the clamp, and `length` the nominal length, in nominal widths. sound:
    whether each edge is reliable at each station, shape (2, n). Both edges of a beam end at its tip. If a single edge
    continues near the nominal length, this edge belongs to a body in the background.
    """
    total = np.cumsum(sound.sum(axis=0) - 1)
    end = len(total) - int(total[::-1].argmax())
    both = np.flatnonzero(sound[:, :end].all(axis=0))
    alone = int(np.searchsorted(along, _SURELY_BEAM * length))
    return min(end, max(int(both[-1]) + 1, alone)) if len(both) else end


def _sound(
    unrolled: UnrolledPicture, edge: Array, support: Array, projected: tuple[ColourProjection, ColourProjection]
) -> Mask:
    """Return whether each of the two edges is reliable at each of n stations, shape (2, n).

    A station is a place along the beam. An edge is reliable where the picture has a clear step of colour at the edge,
    where the edge is smooth, and where the colours beside the edge, inside and outside the beam, differ clearly.
    """
    seam = unrolled.middle + edge[..., None] * unrolled.aside
    turn = np.stack([_turn(side, round(_ARM * unrolled.stations_in_width)) for side in seam])
    separation = np.stack([side.separation for side in projected])
    local = max(3, round(_LOCAL * unrolled.stations_in_width))
    deviation = np.abs(edge - median_filter(edge, size=(1, local), mode="nearest"))
    sound = (support > _HALF) & (turn < _SHARPEST) & (separation > _LEAST_SEPARATION) & (deviation < _OUTLIER)
    shortest = max(2, round(_SHORTEST * unrolled.stations_in_width))
    return np.asarray(binary_opening(sound, np.ones((1, shortest), dtype=bool)))


def _turn(seam: Array, arm: int) -> Array:
    """Return the angle by which an edge turns at each of its n points, rad, not negative, shape (n,).

    seam: the points of the edge, shape (n, 2). The directions of the edge before and after a point are measured over
    `arm` points each.
    """
    padded = np.pad(seam, ((arm, arm), (0, 0)), mode="edge")
    before, after = seam - padded[: len(seam)], padded[2 * arm :] - seam
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return np.abs(np.arctan2(cross, (before * after).sum(axis=1)))


def _longest_chain(seam: Array, width: Array, sound: Mask, scale: float, lever: int) -> Mask:
    """Return whether each of n stations belongs to the longest chain of runs of one edge, shape (n,).

    A run is a sequence of neighbouring stations (places along the beam) at which the edge is sure (reliable). A chain
    consists of runs that continue each other. A run after a gap continues an earlier run on two conditions. First, the
    later run lies near the straight continuation of the earlier run. Second, the beam has about the same width in both
    runs. The tolerances of both conditions grow with the length of the gap.

    The first condition is not checked at a notch: a gap shorter than a quarter of a width, in which the other edge is
    sure. The segments of a soft arm, and the folds of a bellows, have notches.

    These conditions exclude the head of a hammer, the border of a shadow, a body beyond the tip, and a reflection
    near the clamp that interrupts a long edge.

    Parameters
    ----------
    seam : ndarray, shape (n, 2)
        The points of the edge, px.
    width : ndarray, shape (n,)
        Width of the beam in nominal widths; NaN where the other edge is not sure.
    sound : ndarray of bool, shape (n,)
        Whether the edge is sure at each station.
    scale : float
        Nominal width of the beam, px.
    lever : int
        Number of stations over which the direction of the edge before a gap is measured.

    Returns
    -------
    ndarray of bool, shape (n,)
        True for the stations of the longest chain.
    """
    step = np.diff(np.concatenate([[False], sound, [False]]).astype(np.int8))
    chains: list[NDArray[np.int64]] = []
    near = max(3, lever // 4)  # short, because a beam in perspective widens along a longer stretch
    for begin, back in zip(np.flatnonzero(step > 0), np.flatnonzero(step < 0), strict=True):
        run = np.arange(begin, back)
        longest = run[:0]
        for before in chains:
            gap = float(np.linalg.norm(seam[begin] - seam[before[-1]])) / scale
            widths = width[before[-near:]], width[run[:near]]
            notch = gap < _NOTCH and bool(np.isfinite(width[before[-1] : begin + 1]).all())
            goes_on = _as_wide(*widths, gap, _NOTCH_LEAP if notch else _LEAP)
            if len(before) > len(longest) and goes_on and (notch or _leads_to(seam[before], seam[run], scale, lever)):
                longest = before
        chains.append(np.concatenate([longest, run]))
    kept = np.zeros(len(sound), dtype=bool)
    kept[max(chains, key=len, default=np.zeros(0, dtype=np.int64))] = True
    return kept


def _as_wide(before: Array, after: Array, gap: float, leap: float) -> bool:
    """Return whether the beam has about the same width before and after a gap in one of its edges.

    The widths and the length of the gap are in nominal widths, and `leap` is the permitted difference of the widths,
    without the part that grows with the gap. Unknown widths are NaN. The result is True if fewer than
    three widths are known before or after the gap.
    """
    before, after = before[np.isfinite(before)], after[np.isfinite(after)]
    if min(len(before), len(after)) < 3:
        return True
    return bool(abs(np.median(after) - np.median(before)) < leap + _STRAY * gap)


def _leads_to(before: Array, after: Array, scale: float, lever: int) -> bool:
    """Return whether the straight line through the last edge points before a gap leads to the points after the gap.

    before, after: points of the edge before and after the gap, px, shapes (a, 2) and (b, 2). scale: nominal width of
    the beam, px. lever: number of points through which the line is fitted.
    """
    near = before[-lever:]
    middle = near.mean(axis=0)
    direction = np.linalg.svd(near - middle, full_matrices=False)[2][0]
    direction = direction * (1.0 if direction @ (before[-1] - middle) >= 0.0 else -1.0)
    end = middle + ((before[-1] - middle) @ direction) * direction
    ahead = after[: max(1, len(after) // 2)] - end
    along = ahead @ direction
    aside = np.abs(ahead[:, 0] * direction[1] - ahead[:, 1] * direction[0])
    return bool(np.median(along) > 0.0 and np.median(aside - _STRAY * along) < _ASIDE * scale)
