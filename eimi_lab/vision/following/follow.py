"""The way in: one picture, what is stated of the beam, and both its edges with what speaks for and against them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.following.beam_search import WIDTH_PX, Strip, find_strip
from eimi_lab.vision.following.doubts import clipped_share, gleam, penumbra_px, shadow_px
from eimi_lab.vision.following.edge_points import StripEdges, place_side
from eimi_lab.vision.following.ends import as_wide_at_ends
from eimi_lab.vision.following.gleams import without_gleams
from eimi_lab.vision.following.stated import StatedBeam
from eimi_lab.vision.following.support import Sides, find_sides, how_sure
from eimi_lab.vision.following.unrolled import FINENESS, UnrolledPicture, unroll
from eimi_lab.vision.following.working import WorkingPicture, working_picture

Array = NDArray[np.float64]

NARROWEST_PX = 6.0  # of a beam: below, its inside has no pixel clear of both edges
_FIFTHS = 5
_AT_BORDER = 0.75  # widths


@dataclass(frozen=True)
class FollowedBeam:
    """What was found on the way, as far as it went; None for what was not come to.

    findings: what is judged, by the names of the table of flags. left, right: the edges.
    """

    findings: dict[str, float]
    working: WorkingPicture | None = None
    strip: Strip | None = None
    unrolled: UnrolledPicture | None = None
    sides: Sides | None = None
    edges: tuple[StripEdges, StripEdges] | None = None
    words: dict[str, str] = field(default_factory=lambda: {"narrow_px": ""})

    def moved(self, by_px: Array) -> FollowedBeam:
        """The same in a picture from which this one was cut at a place (2,)."""
        return replace(
            self,
            working=self.working and replace(self.working, origin_px=self.working.origin_px + by_px),
            unrolled=self.unrolled and replace(self.unrolled, middle=self.unrolled.middle + by_px),
        )

    @property
    def path_px(self) -> Array:
        """(n, 2) px: the middle of the strip that was followed, in the whole picture; empty where there is none."""
        if self.strip is None or self.working is None:
            return np.zeros((0, 2))
        return self.working.to_picture(self.strip.place)

    @property
    def sure_px(self) -> tuple[Array, ...]:
        """Left and right edge (n, 2) px where they are sure, to a twentieth of a width; none where it came to none."""
        if self.sides is None or self.unrolled is None:
            return ()
        seams = self.unrolled.middle + self.sides.edge[..., None] * self.unrolled.aside
        return tuple(seam[sound] for seam, sound in zip(seams, self.sides.sound, strict=True))


def follow(
    image: NDArray[Any],
    beam: StatedBeam,
    spacing_px: float = 0.0,
    polarity: str | None = None,
    earlier_px: Callable[[], Array | None] = lambda: None,
) -> FollowedBeam:
    """Follow the stated beam in an image (height, width, channels) of 255. It never raises for a picture.

    spacing_px: wanted distance of the points along the edges, of which there are at most a hundred each.
    polarity: whether the beam is "dark" or "bright" against what is beside it, where a person said so. earlier_px:
    gives the middle of the beam in an earlier picture (n, 2), asked for where bodies are equally likely in this one.
    """
    if beam.width_px < NARROWEST_PX:
        return FollowedBeam({"followed_px": beam.width_px}, words=_words(beam))
    nothing = {"followed_length": 0.0}
    coarse = working_picture(image, beam, WIDTH_PX)
    strip = None
    if coarse is not None:
        strip = find_strip(without_gleams(coarse), polarity, lambda: _in_working(coarse, earlier_px()))
    if coarse is None or strip is None:
        return FollowedBeam(nothing, coarse)
    fine = working_picture(image, beam, float(FINENESS))
    unrolled = unroll(fine, coarse, strip) if fine else None
    if unrolled is None:
        return FollowedBeam(nothing, coarse, strip)
    sides = find_sides(unrolled, coarse.noise, beam.length_px / beam.width_px)
    findings = _findings(beam, strip, unrolled, sides, (image.shape[1], image.shape[0]))
    left, right = (place_side(image, unrolled, sides, side, spacing_px) for side in (0, 1))
    if left is None or right is None:
        return FollowedBeam(findings | {"followed_sides": 0.0}, coarse, strip, unrolled, sides)
    left, right = as_wide_at_ends(left, right, beam.width_px)
    findings |= {
        "followed_penumbra": penumbra_px(left, right, sides, beam.width_px),
        "followed_shadow": shadow_px(sides, beam.width_px),
        "followed_gleam": gleam(unrolled, sides),
        "followed_clipped": clipped_share(unrolled, sides),
    }
    return FollowedBeam(findings, coarse, strip, unrolled, sides, (left, right))


def _in_working(picture: WorkingPicture, places_px: Array | None) -> Array | None:
    return None if places_px is None else picture.from_picture(places_px)


def _words(beam: StatedBeam) -> dict[str, str]:
    """For the remedies."""
    return {"narrow_px": f"{beam.width_px:.2g}"}


def _findings(
    beam: StatedBeam, strip: Strip, unrolled: UnrolledPicture, sides: Sides, size: tuple[int, int]
) -> dict[str, float]:
    """Shares of the stated length and width and of the way, by the names of the table of flags. size: the image's."""
    both = sides.sound.all(axis=0)
    if not both.any():
        return {"followed_length": 0.0}
    first = int(both.argmax())
    width = sides.width[both]
    length = float(unrolled.along[sides.end - 1] * beam.width_px / beam.length_px)
    return {
        "followed_length": length,
        "followed_beyond": length,
        **how_sure(sides.sound[:, first : sides.end]),
        "followed_contrast": float(min(np.median(side.separation[: sides.end]) for side in sides.projected)),
        "followed_gain": float(strip.gain.mean()),
        "followed_begin": float(unrolled.along[first]),
        "followed_width": abs(float(np.log(np.median(width)))),
        "followed_narrowing": _narrowing(width),
        "followed_change": _change(width),
        "followed_rival": strip.rival,
        "followed_tip": 1.0,
        "followed_out": float(_is_at_border(unrolled.middle[sides.end - 1], beam.width_px, size)),
    }


def _is_at_border(place: Array, width_px: float, size: tuple[int, int]) -> bool:
    near = _AT_BORDER * width_px
    return bool((place < near).any() or (place > np.array(size) - 1.0 - near).any())


def _change(width: Array) -> float:
    """By which share the widest fifth of the beam is wider than the narrowest."""
    medians = [float(np.median(part)) for part in np.array_split(width, _FIFTHS) if len(part)]
    return max(medians) / max(min(medians), 1e-3) - 1.0


def _narrowing(width: Array) -> float:
    """By which share a fifth of the beam is narrower than one before it: a tail or a drop's neck, but no beam."""
    medians = np.array([np.median(part) for part in np.array_split(width, _FIFTHS) if len(part)])
    return float(max(0.0, (1.0 - medians / np.maximum.accumulate(medians)).max()))
