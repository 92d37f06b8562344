"""Follow the beam in one image: locate both edges, and measure their quality."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.following.beam_search import WIDTH_PX, Strip, find_strip
from eimi_lab.vision.following.crossings import leave_out_crossings
from eimi_lab.vision.following.doubts import clipped_share, penumbra_px, reflection_share, shadow_px
from eimi_lab.vision.following.edge_points import StripEdges, locate_edge
from eimi_lab.vision.following.ends import trim_ends
from eimi_lab.vision.following.reflections import remove_reflections
from eimi_lab.vision.following.stated import StatedBeam
from eimi_lab.vision.following.support import Sides, find_sides, sure_share
from eimi_lab.vision.following.texture import average_texture
from eimi_lab.vision.following.unrolled import FINENESS, UnrolledPicture, unroll
from eimi_lab.vision.following.working import WorkingPicture, working_picture

Array = NDArray[np.float64]

NARROWEST_PX = 6.0  # width of a beam: inside a narrower one no pixel is clear of both edges
_FIFTHS = 5  # stretches whose widths are compared
_UNBROKEN = 0.9  # of the path from the first sure place, on which either edge is sure
_UNSEEN = 0.1  # of the path from the clamp, in which no edge needs to be sure
_TO_TIP = 0.8  # of the stated length, which is known to a tenth, and the tip of a beam is rounded
_CLEAR_GAIN = 0.5
_CLEAR_CONTRAST = 6.0  # standard deviations
_AT_BORDER = 0.75  # widths from the border of the image


@dataclass(frozen=True)
class FollowedBeam:
    """The result of following a beam in one image. An attribute that was not computed is None.

    Attributes
    ----------
    findings : dict of str to float
        Measured values, by the keys of the quality checks.
    working : WorkingPicture, optional
        The picture in which the beam was searched.
    strip : Strip, optional
        The strip of this picture that shows the beam.
    unrolled : UnrolledPicture, optional
        The straightened picture of the beam.
    sides : Sides, optional
        Both edges in the straightened picture.
    edges : tuple of StripEdges, optional
        The left and the right edge, px.
    words : dict of str to str
        Texts that replace words in braces, such as {narrow_px}, in the advice of the quality checks.
    """

    findings: dict[str, float]
    working: WorkingPicture | None = None
    strip: Strip | None = None
    unrolled: UnrolledPicture | None = None
    sides: Sides | None = None
    edges: tuple[StripEdges, StripEdges] | None = None
    words: dict[str, str] = field(default_factory=lambda: {"narrow_px": "", "clicks_off": ""})

    def moved(self, by_px: Array) -> FollowedBeam:
        """Return this result with its path and reliable points in px of a larger picture, but with unchanged `edges`.

        `by_px` is the upper left corner of the searched image in the larger picture.
        """
        return replace(
            self,
            working=self.working and replace(self.working, origin_px=self.working.origin_px + by_px),
            unrolled=self.unrolled and replace(self.unrolled, middle=self.unrolled.middle + by_px),
        )

    @property
    def path_px(self) -> Array:
        """The centre line along which the beam was followed, px, shape (n, 2); empty if no beam was found."""
        if self.strip is None or self.working is None:
            return np.zeros((0, 2))
        return self.working.to_picture(self.strip.place)

    @property
    def sure_px(self) -> tuple[Array, ...]:
        """The reliable points of the left and of the right edge, px, each of shape (n, 2); empty without edges."""
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
    """Follow a beam from its clamp in one image.

    Parameters
    ----------
    image : ndarray, shape (H, W, channels)
        Grey values from 0 to 255; H rows, W columns.
    beam : StatedBeam
        Clamp, axis, width and length in pixels.
    spacing_px : float
        Desired distance between the points along an edge, which has at most a hundred points.
    polarity : {"dark", "bright"}, optional
        Whether the beam is darker or brighter than its surroundings; None if either is possible.
    earlier_px : callable, optional
        Returns n points of the beam's centre line in an earlier picture, px, shape (n, 2), or None. Called only if
        several bodies are equally likely to be the beam.

    Returns
    -------
    FollowedBeam
        Both edges in px, the measured values and the intermediate results.
    """
    if beam.width_px < NARROWEST_PX:
        return FollowedBeam({"followed_px": beam.width_px}, words=_words(beam))
    nothing = {"followed_length": 0.0}
    coarse = working_picture(image, beam, WIDTH_PX)
    strip = None
    if coarse is not None:
        strip = find_strip(remove_reflections(coarse), polarity, lambda: _in_working(coarse, earlier_px()))
    if coarse is None or strip is None:
        return FollowedBeam(nothing, coarse)
    fine = working_picture(image, beam, min(float(FINENESS), beam.width_px))  # reduced, but never enlarged
    unrolled = unroll(fine, coarse, strip) if fine else None
    if unrolled is None:
        return FollowedBeam(nothing, coarse, strip)
    unrolled = leave_out_crossings(unrolled)
    sides = find_sides(unrolled, coarse.noise, beam.length_px / beam.width_px, beam.clicked_px / beam.width_px)
    findings = _findings(beam, strip, unrolled, sides, (image.shape[1], image.shape[0]))
    left, right = (locate_edge(image, unrolled, sides, side, spacing_px) for side in (0, 1))
    if left is None or right is None:
        return FollowedBeam(findings | {"followed_sides": 0.0}, coarse, strip, unrolled, sides)
    left, right = trim_ends(left, right, beam.width_px, lambda along: beam.relative_width(along * beam.width_px))
    findings |= {
        "followed_penumbra": penumbra_px(left, right, sides, beam.width_px),
        "followed_shadow": shadow_px(sides, beam.width_px),
        "followed_gleam": reflection_share(unrolled, sides),
        "followed_clipped": clipped_share(unrolled, sides),
    }
    edges = average_texture(left, beam.width_px), average_texture(right, beam.width_px)
    return FollowedBeam(findings, coarse, strip, unrolled, sides, edges)


def _in_working(picture: WorkingPicture, places_px: Array | None) -> Array | None:
    return None if places_px is None else picture.from_picture(places_px)


def _words(beam: StatedBeam) -> dict[str, str]:
    return {"narrow_px": f"{math.floor(10 * beam.width_px) / 10:g}", "clicks_off": ""}


def _findings(
    beam: StatedBeam, strip: Strip, unrolled: UnrolledPicture, sides: Sides, size: tuple[int, int]
) -> dict[str, float]:
    both = sides.sound.all(axis=0)
    if not both.any():
        return {"followed_length": 0.0}
    first = int(both.argmax())
    width = (sides.width / unrolled.stated)[both]
    length = float(unrolled.along[sides.end - 1] * beam.width_px / beam.length_px)
    contrast = float(min(np.median(side.separation[: sides.end]) for side in sides.projected))
    gain = float(strip.gain.mean())
    unbroken = bool(sides.sound[:, first : sides.end].mean(axis=1).min() > _UNBROKEN)
    begin = max(0.0, float(unrolled.along[first] - _UNSEEN * unrolled.along[sides.end - 1]))
    clear = unbroken and float(np.median(strip.gain)) > _CLEAR_GAIN and contrast > _CLEAR_CONTRAST
    return {
        "followed_stretch" if clear else "followed_length": length,
        "followed_beyond": length,
        **sure_share(sides.sound[:, first : sides.end]),
        "followed_contrast": contrast,
        "followed_faint" if unbroken and length > _TO_TIP else "followed_gain": gain,
        "followed_late" if clear else "followed_begin": begin,
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
    """Return by how much the largest width of the beam exceeds the smallest, divided by the smallest."""
    medians = [float(np.median(part)) for part in np.array_split(width, _FIFTHS) if len(part)]
    return max(medians) / max(min(medians), 1e-3) - 1.0


def _narrowing(width: Array) -> float:
    """Return by which part (0 to 1) of its width the beam becomes narrower away from the clamp."""
    medians = np.array([np.median(part) for part in np.array_split(width, _FIFTHS) if len(part)])
    return float(max(0.0, (1.0 - medians / np.maximum.accumulate(medians)).max()))
