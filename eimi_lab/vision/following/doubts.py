"""Measure shadows, reflections and saturated colours at the edges of a beam that was followed from its clamp."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.following.colour_seams import OUTWARD
from eimi_lab.vision.following.discriminant import INSIDE_BAND, OUTSIDE_BAND
from eimi_lab.vision.following.edge_points import StripEdges
from eimi_lab.vision.following.reflections import CLIPPED
from eimi_lab.vision.following.support import Sides
from eimi_lab.vision.following.unrolled import UnrolledPicture

Mask = NDArray[np.bool_]

_SOFTER = 1.25  # times the other edge's blur; light from one side makes the edges of a body differ by up to 1.6
_SOFTEST = 2.0  # times the other edge's blur; no lens or shading causes a larger ratio
_FULL = 253.0  # of 255: JPEG compression may lower a clipped value
_NEAR = 0.2  # widths on both sides of an edge: the border of a reflection there may be taken for the edge
_AMID = 0.2  # widths on both sides of the middle of the beam, for the colour of the beam itself


def penumbra_px(left: StripEdges, right: StripEdges, sides: Sides, width_px: float) -> float:
    """Return by how much (px) an edge may be wrong because it is the blurred border of the beam's own shadow.

    `width_px` is the width of the beam according to the specimen file.
    """
    blur_px = left.blur_px, right.blur_px
    soft = int(blur_px[1] > blur_px[0])
    # The border of a shadow is more blurred than an edge, because the lamp has a size, and darkens every colour.
    ratio = blur_px[soft] / blur_px[1 - soft]
    sound = sides.sound[soft]
    darkens = bool((np.median(sides.projected[soft].step[sound], axis=0) < 0.0).all())
    if ratio < _SOFTER or (ratio < _SOFTEST and not darkens):
        return 0.0
    both = sides.sound.all(axis=0)
    wider = float(np.median(sides.width[both])) - 1.0 if both.any() else 0.0
    return max(blur_px[soft], wider * width_px)


def shadow_px(sides: Sides, width_px: float) -> float:
    """Return by how much (px) the edges may be wrong because of shadows beside the beam."""
    return width_px * float(np.sqrt((sides.shadow[sides.sound] ** 2).mean()))


def reflection_share(unrolled: UnrolledPicture, sides: Sides) -> float:
    """Return the part (0 to 1) of an edge's length on which a lamp is reflected.

    Of the values for the two edges, the result is the larger.
    """
    clipped = (unrolled.colours >= CLIPPED).mean(axis=2) > 0.5
    middle_clipped = (clipped & (np.abs(unrolled.across - sides.edge.mean(axis=0)[:, None]) <= _AMID)).any(axis=1)
    shares = []
    for edge, outward, sound in zip(sides.edge, OUTWARD, sides.sound, strict=True):
        away = outward * (unrolled.across - edge[:, None])
        surroundings_clipped = (clipped & (away > _NEAR) & (away <= OUTSIDE_BAND[1])).any(axis=1)
        reflects = (clipped & (np.abs(away) <= _NEAR)).any(axis=1) & ~middle_clipped & ~surroundings_clipped
        shares.append(float(reflects[sound].mean()) if sound.any() else 0.0)
    return max(shares)


def clipped_share(unrolled: UnrolledPicture, sides: Sides) -> float:
    """Return the part (0 to 1) of an edge's length beside which a colour is saturated.

    Of the values for the two edges, the result is the larger.
    """
    full = (unrolled.colours >= _FULL).any(axis=2)
    shares = []
    for edge, outward, sound in zip(sides.edge, OUTWARD, sides.sound, strict=True):
        away = outward * (unrolled.across - edge[:, None])
        clipped = np.zeros(len(edge), dtype=bool)
        for near in (
            (-away >= INSIDE_BAND[0]) & (-away <= INSIDE_BAND[1]),
            (away >= OUTSIDE_BAND[0]) & (away <= OUTSIDE_BAND[1]),
        ):
            clipped |= (full & near).sum(axis=1) > 0.5 * near.sum(axis=1)
        shares.append(float(clipped[sound].mean()) if sound.any() else 0.0)
    return max(shares)
