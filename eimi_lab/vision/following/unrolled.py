"""The strip unrolled: its picture with the beam's middle straight, so that both edges are nearly so."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.edges.curve import SmoothCurve
from eimi_lab.vision.edges.profiles import normals_of
from eimi_lab.vision.following.beam_search import Strip
from eimi_lab.vision.following.hypotheses import read_colours
from eimi_lab.vision.following.working import WorkingPicture

Array = NDArray[np.float64]

FINENESS = 24  # pixels and stations in the beam's width
_REACH = 1.1  # widths to both sides of the middle: an edge, and 0.55 of a width outside it
_ALONG = 2.0 / FINENESS  # widths
_PIECE = 1.5  # widths: a spline's interval; a curvature that changes faster is the search's own unrest
_BINS = 12  # a channel
_BEYOND = 0.6  # widths at the far end


@dataclass(frozen=True)
class ColourBins:
    """index: (n, m) which bin of a histogram of the picture's colours each is in. shape: bins in each channel."""

    index: NDArray[np.int64]
    shape: tuple[int, ...]

    @property
    def total(self) -> int:
        return math.prod(self.shape)


@dataclass(frozen=True)
class UnrolledPicture:
    """colours: (n, m, channels) at places along the beam and across it. across: (m,) and along: (n,) in stated widths.

    middle, aside: (n, 2) px of the whole picture: the place amid the strip and one stated width to its right (clockwise
    of the way from the clamp). width: (n,) of the strip, in stated ones. inside: (n, m) which lie in the frame.
    """

    colours: NDArray[np.float32]
    across: Array
    along: Array
    middle: Array
    aside: Array
    width: Array
    inside: NDArray[np.bool_]

    @cached_property
    def bins(self) -> ColourBins:
        """Of a histogram that leaves out the rarest hundredth."""
        channels = self.colours.shape[2]
        bins = _BINS if channels > 1 else 3 * _BINS
        low, high = np.percentile(self.colours.reshape(-1, channels), (0.5, 99.5), axis=0)
        index = np.clip((self.colours - low) / np.maximum(high - low, 1.0) * bins, 0, bins - 1).astype(np.int64)
        shape = (bins,) * channels
        return ColourBins(np.ravel_multi_index(tuple(np.moveaxis(index, -1, 0)), shape), shape)

    @property
    def stations_in_width(self) -> float:
        """Along the beam."""
        return 1.0 / _ALONG


def unroll(fine: WorkingPicture, coarse: WorkingPicture, strip: Strip) -> UnrolledPicture | None:
    """The strip, found in ``coarse``, from ``fine``; from the clamp to somewhat beyond its end. None if too short."""
    places = fine_places(strip.place, coarse, fine)
    wide = fine.beam.width_px
    if len(places) < 5:
        return None
    length = strip.length_px / coarse.beam.width_px
    curve = SmoothCurve(places, max(1, round(length / _PIECE)))
    start = -float((places[0] - fine.beam.clamp_px) @ fine.beam.ahead) / wide
    along = np.arange(start, curve.length / wide + _BEYOND, _ALONG)
    middle, tangent = curve.at(along * wide)
    normal = normals_of(tangent)
    side = round(_REACH * FINENESS)
    across = np.arange(-side, side + 1) / FINENESS
    x = middle[:, :1] + wide * across * normal[:, :1]
    y = middle[:, 1:] + wide * across * normal[:, 1:]
    colours = read_colours(fine.pixels, x, y)
    high, broad = fine.pixels.shape[:2]
    inside = (x >= -0.5) & (y >= -0.5) & (x <= broad - 0.5) & (y <= high - 0.5)
    node = np.linspace(0.0, curve.length / wide, len(strip.width))
    width = np.interp(along, node, strip.width / coarse.beam.width_px)
    begin = fine.to_picture(middle)
    return UnrolledPicture(
        colours=colours,
        across=across,
        along=along - start,
        middle=begin,
        aside=fine.to_picture(middle + wide * normal) - begin,
        width=width,
        inside=inside,
    )


def fine_places(points: Array, coarse: WorkingPicture, fine: WorkingPicture) -> Array:
    """Places (n, 2) of one working picture in another."""
    return fine.from_picture(coarse.to_picture(points))
