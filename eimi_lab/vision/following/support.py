"""Where along the beam each edge is sure, and where the beam ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_opening, median_filter

from eimi_lab.vision.following.colour_seams import OUTWARD, find_colour_seams
from eimi_lab.vision.following.discriminant import ColourProjection
from eimi_lab.vision.following.shadows import off_shadows
from eimi_lab.vision.following.unrolled import UnrolledPicture

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

TOLERANCES = (0.3, 0.2, 0.2)  # widths by which an edge may be off the strip's, then off the seam before
_HALF = 0.5  # of a whole edge's fall
_LEAST_SEPARATION = 3.0  # standard deviations between inside and outside
_ARM = 0.25  # widths to both sides of a station, over which an edge's turn is measured
_SHARPEST = 0.5  # rad: a beam that bends as sharply as is allowed for turns by 0.4 there; this is a shoulder
_LEVER = 1.5  # widths before a gap that tell its direction
_SHORTEST = 0.2  # widths: a shorter run of sure stations may be anything
_LEAP = 0.1  # widths by which the width may be another there,
_ASIDE = 0.12  # widths by which an edge may come out of a gap beside where it would have gone on straight,
_STRAY = 0.25  # and for each width on the way
_LOCAL = 1.0  # widths: a running median's window
_OUTLIER = 0.08  # widths off it
_LONGEST_GAP = 0.1  # of the way: within so little of its length a beam bends in no other way
_SURELY_BEAM = 0.9  # of the length, which is stated to a tenth


@dataclass(frozen=True)
class Sides:
    """Both edges in the unrolled strip: left, right.

    edge: (2, n) places across, widths. support: (2, n) 0 to 1 how much of a whole edge falls there. sound: (2, n) where
    an edge is sure. end: number of the stations before the beam's end. shadow: (2, n) widths by which an edge was moved
    off the border of a shadow.
    """

    edge: Array
    support: Array
    sound: Mask
    end: int
    projected: tuple[ColourProjection, ColourProjection]
    shadow: Array

    @property
    def width(self) -> Array:
        """(n,) in stated widths."""
        return np.asarray(self.edge[1] - self.edge[0])


def find_sides(unrolled: UnrolledPicture, noise: float, length: float) -> Sides:
    """Both seams, in three passes that each take what is inside and outside from the one before.

    length: stated, in widths.
    """
    strip = np.outer(OUTWARD, 0.5 * unrolled.width)
    seams = off_shadows(unrolled, find_colour_seams(unrolled, strip, noise, TOLERANCES), noise)
    edge, sure, projected = seams.edge, seams.support, seams.projected
    sound = _sound(unrolled, edge, sure, projected)
    # The beam ends where the support of both sides sums to most.
    sound[:, int(np.cumsum(sure.sum(axis=0) - 2.0 * _HALF).argmax()) + 1 :] = False
    scale = float(np.linalg.norm(unrolled.aside[0]))
    lever = round(_LEVER * unrolled.stations_in_width)
    for row in (0, 1):
        seam = unrolled.middle + edge[row][:, None] * unrolled.aside
        width = np.where(sound[1 - row], edge[1] - edge[0], np.nan)
        sound[row] = _continued(seam, width, sound[row], scale, lever)
    end = _end(unrolled.along, sound, length)
    sound[:, end:] = False
    return Sides(edge, sure, sound, end, projected, seams.shadow)


def how_sure(sound: Mask) -> dict[str, float]:
    """Share of the way (2, n) on which the worse edge is sure, named by whether those places are spread all along it.

    Then the gaps are short for the beam's length: what was followed leaves and meets its edge again and again.
    """
    worse = sound[int(sound.mean(axis=1).argmin())]
    at = np.flatnonzero(np.concatenate([[True], worse, [True]]))
    spread = float(np.diff(at).max() - 1) < _LONGEST_GAP * len(worse)
    return {"followed_patches" if spread else "followed_sides": float(worse.mean())}


def _end(along: Array, sound: Mask, length: float) -> int:
    """The number of stations before the beam's end.

    Both edges of a beam end at its tip. One that goes on alone there, where the beam may be at its end, is of
    something behind it.
    """
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
    off = np.abs(edge - median_filter(edge, size=(1, local), mode="nearest"))
    sound = (support > _HALF) & (turn < _SHARPEST) & (separation > _LEAST_SEPARATION) & (off < _OUTLIER)
    shortest = max(2, round(_SHORTEST * unrolled.stations_in_width))
    return np.asarray(binary_opening(sound, np.ones((1, shortest), dtype=bool)))


def _turn(seam: Array, arm: int) -> Array:
    """(n,) rad by which a seam (n, 2) turns between one arm before a station and one behind it."""
    padded = np.pad(seam, ((arm, arm), (0, 0)), mode="edge")
    before, after = seam - padded[: len(seam)], padded[2 * arm :] - seam
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return np.abs(np.arctan2(cross, (before * after).sum(axis=1)))


def _continued(seam: Array, width: Array, sound: Mask, scale: float, lever: int) -> Mask:
    """(n,) the sound stations of one side that go on from one another, the most that do.

    seam: (n, 2) px. width: (n,) in stated ones, NaN where the other edge is not sure. scale: px in a width. lever: how
    many stations tell a direction. Beyond a gap an edge has to lie where going on straight leads, give or take what it
    may have bent meanwhile, and the beam has to be as wide as before. That tells a hammer's head, the border of a
    shadow, or what is behind the tip, from the beam; and a gleam near the clamp from the long edge that it interrupts.
    """
    step = np.diff(np.concatenate([[False], sound, [False]]).astype(np.int8))
    chains: list[NDArray[np.int64]] = []
    near = max(3, lever // 4)  # a beam in perspective widens along a longer stretch
    for begin, back in zip(np.flatnonzero(step > 0), np.flatnonzero(step < 0), strict=True):
        run = np.arange(begin, back)
        longest = run[:0]
        for before in chains:
            gap = float(np.linalg.norm(seam[begin] - seam[before[-1]])) / scale
            goes_on = _as_wide(width[before[-near:]], width[run[:near]], gap)
            if len(before) > len(longest) and goes_on and _leads_to(seam[before], seam[run], scale, lever):
                longest = before
        chains.append(np.concatenate([longest, run]))
    kept = np.zeros(len(sound), dtype=bool)
    kept[max(chains, key=len, default=np.zeros(0, dtype=np.int64))] = True
    return kept


def _as_wide(before: Array, after: Array, gap: float) -> bool:
    """Whether a body is as wide behind a gap of so many widths as before; true where nothing tells."""
    before, after = before[np.isfinite(before)], after[np.isfinite(after)]
    if min(len(before), len(after)) < 3:
        return True
    return bool(abs(np.median(after) - np.median(before)) < _LEAP + _STRAY * gap)


def _leads_to(before: Array, after: Array, scale: float, lever: int) -> bool:
    """Whether the line through the last of the places before a gap meets those behind it."""
    near = before[-lever:]
    middle = near.mean(axis=0)
    direction = np.linalg.svd(near - middle, full_matrices=False)[2][0]
    direction = direction * (1.0 if direction @ (before[-1] - middle) >= 0.0 else -1.0)
    end = middle + ((before[-1] - middle) @ direction) * direction
    ahead = after[: max(1, len(after) // 2)] - end
    along = ahead @ direction
    aside = np.abs(ahead[:, 0] * direction[1] - ahead[:, 1] * direction[0])
    return bool(np.median(along) > 0.0 and np.median(aside - _STRAY * along) < _ASIDE * scale)
