"""Decide at which places along the beam each edge is reliable, and where the beam ends."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from eimi_lab.vision.following.colour_seams import OUTWARD, find_colour_seams
from eimi_lab.vision.following.discriminant import ColourProjection
from eimi_lab.vision.following.shadows import move_off_shadows
from eimi_lab.vision.following.stated_width import prefer_stated_width
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
_BESIDE_LEAP = 0.15  # widths by which the width may differ behind a gap beside which the other edge is sure
_LONG = 0.6  # widths: a shorter chain does not show how the body continues beside a sure edge
_LEAP = 0.1  # widths by which the width may differ behind a gap
_ASIDE = 0.12  # widths by which an edge behind a gap may lie beside its straight continuation
_STRAY = 0.25  # widths that are added to _BESIDE_LEAP, _LEAP and _ASIDE for each width of the gap
_LOCAL = 1.0  # widths: window of a running median of the edge
_OUTLIER = 0.08  # widths from the running median
_LONGEST_GAP = 0.1  # of the followed path: a beam does not change its bend over so short a stretch
_SURELY_BEAM = 0.9  # of the stated length, which is known to a tenth


@dataclass(frozen=True)
class Sides:
    """The left and the right edge in each of the n rows of the straightened picture of the beam.

    Each row of this picture crosses the beam. The unit of all lengths is the width of the beam.

    Attributes
    ----------
    edge : ndarray, shape (2, n)
        Position of the left edge (row 0) and of the right edge (row 1) across the beam.
    support : ndarray, shape (2, n)
        Change of colour at the edge, from 0 to 1; 1 is a full step from the inside to the outside colour.
    sound : ndarray of bool, shape (2, n)
        Whether the edge is reliable.
    end : int
        Number of rows before the end of the beam.
    projected : tuple of ColourProjection
        For each edge, the weights with which the weighted sum of the colours has a clear step at this edge.
    shadow : ndarray, shape (2, n)
        Distance between an edge and the border of a possible shadow of the beam; 0 without such a border.
    """

    edge: Array
    support: Array
    sound: Mask
    end: int
    projected: tuple[ColourProjection, ColourProjection]
    shadow: Array

    @property
    def width(self) -> Array:
        """Width of the beam in each row of the straightened picture, divided by the width in the specimen file."""
        return np.asarray(self.edge[1] - self.edge[0])


def find_sides(unrolled: UnrolledPicture, noise: float, length: float, clicked: float = 0.0) -> Sides:
    """Find both edges in the straightened picture of the beam, and where each edge is reliable.

    Parameters
    ----------
    unrolled : UnrolledPicture
        The straightened picture.
    noise : float
        Standard deviation of the noise, grey levels (0 to 255).
    length : float
        Length of the beam in the specimen file, in widths of the beam.
    clicked : float
        Distance from the clamp to the last point that a person clicked, in widths of the beam.
    """
    strip = np.outer(OUTWARD, 0.5 * unrolled.width)
    seams = move_off_shadows(unrolled, find_colour_seams(unrolled, strip, noise, TOLERANCES), noise)
    # The beam ends where the cumulative support of both sides, less 2 · _HALF at each station, is largest.
    total = np.cumsum(seams.support.sum(axis=0) - 2.0 * _HALF)
    total[: np.searchsorted(unrolled.along[:-1], clicked)] = -np.inf
    last = int(total.argmax())
    seams = prefer_stated_width(unrolled, seams, noise, last + 1)
    edge, support, projected = seams.edge, seams.support, seams.projected
    sound = _sound(unrolled, edge, support, projected)
    sound[:, last + 1 :] = False
    scale = float(np.linalg.norm(unrolled.aside[0]))
    lever = round(_LEVER * unrolled.stations_in_width)
    for row in (0, 1):
        seam = unrolled.middle + edge[row][:, None] * unrolled.aside
        width = np.where(sound[1 - row], (edge[1] - edge[0]) / unrolled.stated, np.nan)
        sound[row] = _longest_chain(seam, width, sound[row], scale, lever)
    end = _end(unrolled.along, sound, length)
    sound[:, end:] = False
    return Sides(edge, support, sound, end, projected, seams.shadow)


def sure_share(sound: Mask) -> dict[str, float]:
    """Return the part (0 to 1) of the beam's length on which the less clear edge is reliable.

    The key of the result is its name in the quality checks. `sound` (2, n) tells where the left and the right edge are
    reliable.
    """
    worse = sound[int(sound.mean(axis=1).argmin())]
    boundaries = np.flatnonzero(np.concatenate([[True], worse, [True]]))
    # short gaps are patches; a long gap concerns one side
    spread = float(np.diff(boundaries).max() - 1) < _LONGEST_GAP * len(worse)
    return {"followed_patches" if spread else "followed_sides": float(worse.mean())}


def _end(along: Array, sound: Mask, length: float) -> int:
    """Return how many rows of the straightened picture lie before the end of the beam."""
    # If only one edge continues near the length of the beam, it belongs to a body in the background.
    total = np.cumsum(sound.sum(axis=0) - 1)
    end = len(total) - int(total[::-1].argmax())
    both = np.flatnonzero(sound[:, :end].all(axis=0))
    alone = int(np.searchsorted(along, _SURELY_BEAM * length))
    return min(end, max(int(both[-1]) + 1, alone)) if len(both) else end


def _sound(
    unrolled: UnrolledPicture, edge: Array, support: Array, projected: tuple[ColourProjection, ColourProjection]
) -> Mask:
    seam = unrolled.middle + edge[..., None] * unrolled.aside
    turn = np.stack([_turn(side, round(_ARM * unrolled.stations_in_width)) for side in seam])
    separation = np.stack([side.separation for side in projected])
    local = max(3, round(_LOCAL * unrolled.stations_in_width))
    deviation = np.abs(edge - scipy.ndimage.median_filter(edge, size=(1, local), mode="nearest"))
    sound = (support > _HALF) & (turn < _SHARPEST) & (separation > _LEAST_SEPARATION) & (deviation < _OUTLIER)
    shortest = max(2, round(_SHORTEST * unrolled.stations_in_width))
    return np.asarray(scipy.ndimage.binary_opening(sound, np.ones((1, shortest), dtype=bool)))


def _turn(seam: Array, arm: int) -> Array:
    """Return the angle (rad, not negative) by which an edge turns at each of its points."""
    padded = np.pad(seam, ((arm, arm), (0, 0)), mode="edge")
    before, after = seam - padded[: len(seam)], padded[2 * arm :] - seam
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return np.abs(np.arctan2(cross, (before * after).sum(axis=1)))


def _longest_chain(seam: Array, width: Array, sound: Mask, scale: float, lever: int) -> Mask:
    # Return which of n points along the beam belong to its edge, and not to a shadow or a stain.
    # `seam`: distance of each point across the beam, px. `sound`: whether the point is reliable. `width`: width of the
    # beam, divided by the expected width; NaN where unknown. `scale`: expected width, px. `lever`: number of points
    # from which a direction is computed.
    # Runs of reliable points that continue each other across a gap form a chain; the longest chain is the edge.
    step = np.diff(np.concatenate([[False], sound, [False]]).astype(np.int8))
    chains: list[_Chain] = []
    long = round(_LONG / _LEVER * lever)
    near = max(3, lever // 4)  # short, because a beam in perspective widens along a longer stretch
    # A run of reliable places continues a chain that leads straight to it with about the same width. Beside a reliable
    # opposite edge, the chain may bend: segments of a soft arm, folds of a bellows and stains cause such gaps.
    for begin, back in zip(np.flatnonzero(step > 0), np.flatnonzero(step < 0), strict=True):
        run = np.arange(begin, back)
        ahead, width_ahead = seam[run[: max(1, len(run) // 2)]], _median_width(width[run[:near]])
        longest = run[:0]
        for before in sorted(chains, key=len, reverse=True):
            gap = float(np.linalg.norm(seam[begin] - before.end)) / scale
            beside = bool(np.isfinite(width[before.stations[-1] : begin + 1]).all())
            difference = abs(width_ahead - before.width)  # NaN if one of the widths is unknown
            as_wide = beside and difference < _BESIDE_LEAP + _STRAY * min(gap, _NOTCH)
            as_wide &= gap < _NOTCH or len(before) >= long
            if as_wide or (not difference >= _LEAP + _STRAY * gap and before.leads_to(ahead, scale)):
                longest = before.stations
                break
        chains.append(_Chain.through(seam, width, np.concatenate([longest, run]), lever, near))
    kept = np.zeros(len(sound), dtype=bool)
    if chains:
        kept[max(chains, key=len).stations] = True
    return kept


@dataclass(frozen=True)
class _Chain:
    """Parts of one edge of the beam that were joined across gaps.

    Attributes
    ----------
    stations : ndarray of int, shape (n,)
        Indices of the edge points in these parts, from the clamp outward.
    end : ndarray, shape (2,)
        The last point of the edge, px.
    foot, direction : ndarray, shape (2,)
        A point (px) and the unit vector (away from the clamp) of the straight line through the last points.
    width : float
        Width of the beam near the last point, divided by its width in the specimen file; NaN if unknown.
    """

    stations: NDArray[np.int64]
    end: Array
    foot: Array
    direction: Array
    width: float

    def __len__(self) -> int:
        return len(self.stations)

    @classmethod
    def through(cls, seam: Array, width: Array, stations: NDArray[np.int64], lever: int, near: int) -> _Chain:
        last = seam[stations[-lever:]]
        end, middle = last[-1], last.mean(axis=0)
        direction = np.linalg.svd(last - middle, full_matrices=False)[2][0]
        direction = direction * (1.0 if direction @ (end - middle) >= 0.0 else -1.0)
        foot = middle + ((end - middle) @ direction) * direction
        return cls(stations, end, foot, direction, _median_width(width[stations[-near:]]))

    def leads_to(self, ahead: Array, scale: float) -> bool:
        """Return whether this part of an edge, continued as a straight line, leads to given points after a gap."""
        offset = ahead - self.foot
        along = offset @ self.direction
        aside = np.abs(offset[:, 0] * self.direction[1] - offset[:, 1] * self.direction[0])
        return bool(np.median(along) > 0.0 and np.median(aside - _STRAY * along) < _ASIDE * scale)


def _median_width(widths: Array) -> float:
    finite = widths[np.isfinite(widths)]
    return float(np.median(finite)) if len(finite) >= 3 else math.nan
