"""What a followed beam's edges may be instead of edges, borders of shadows and reflections, and what clipping does."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.following.colour_seams import OUTWARD
from eimi_lab.vision.following.discriminant import INSIDE_BAND, OUTSIDE_BAND
from eimi_lab.vision.following.edge_points import StripEdges
from eimi_lab.vision.following.gleams import CLIPPED
from eimi_lab.vision.following.support import Sides
from eimi_lab.vision.following.unrolled import UnrolledPicture

Mask = NDArray[np.bool_]

_SOFTER = 1.25  # times the other edge's blur; by light from one side a body's edges differ by up to 1.6,
_SOFTEST = 2.0  # and no lens or shading makes more of it
_FULL = 253.0  # of 255, after a JPEG
_NEAR = 0.2  # widths to both sides of an edge: a reflection there has its own border where the edge is looked for
_AMID = 0.2  # widths to both sides of the middle: the beam's own colour


def penumbra_px(left: StripEdges, right: StripEdges, sides: Sides, width_px: float) -> float:
    """How far the softer edge may be off, if it is the border of the beam's own shadow; 0 where it is none.

    Both edges of one body are about equally far from the lens. A shadow's border has the lamp's size in it as well, and
    its inside is the darker one in every colour. It lies outside the body, which looks wider by as much.
    """
    blur_px = left.blur_px, right.blur_px
    soft = int(blur_px[1] > blur_px[0])
    ratio = blur_px[soft] / blur_px[1 - soft]
    sound = sides.sound[soft]
    darkens = bool((np.median(sides.projected[soft].step[sound], axis=0) < 0.0).all())
    if ratio < _SOFTER or (ratio < _SOFTEST and not darkens):
        return 0.0
    both = sides.sound.all(axis=0)
    wider = float(np.median(sides.width[both])) - 1.0 if both.any() else 0.0
    return max(blur_px[soft], wider * width_px)


def shadow_px(sides: Sides, width_px: float) -> float:
    """By how much edges were moved off the borders of shadows, root mean square over both where they are sure."""
    return width_px * float(np.sqrt((sides.shadow[sides.sound] ** 2).mean()))


def gleam(unrolled: UnrolledPicture, sides: Sides) -> float:
    """Share of the worse edge along which a lamp's reflection lies: clipped, while what is beside it is not."""
    clipped = (unrolled.colours >= CLIPPED).mean(axis=2) > 0.5
    own = (clipped & (np.abs(unrolled.across - sides.edge.mean(axis=0)[:, None]) <= _AMID)).any(axis=1)
    shares = []
    for edge, outward, sound in zip(sides.edge, OUTWARD, sides.sound, strict=True):
        away = outward * (unrolled.across - edge[:, None])
        wall = (clipped & (away > _NEAR) & (away <= OUTSIDE_BAND[1])).any(axis=1)
        shines = (clipped & (np.abs(away) <= _NEAR)).any(axis=1) & ~own & ~wall
        shares.append(float(shines[sound].mean()) if sound.any() else 0.0)
    return max(shares)


def clipped_share(unrolled: UnrolledPicture, sides: Sides) -> float:
    """Share of the worse edge at which the light on one side of it is clipped in a colour: it then looks wider."""
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
