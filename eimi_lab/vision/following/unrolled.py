"""Sample the image along and across the beam. In the sampled picture the beam is straight."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.edges.curve import SmoothCurve
from eimi_lab.vision.edges.profiles import normals_of
from eimi_lab.vision.following.beam_search import Strip
from eimi_lab.vision.following.hypotheses import read_colours
from eimi_lab.vision.following.working import WorkingPicture

Array = NDArray[np.float64]

FINENESS = 24  # places across in the beam's width
_REACH = 1.1  # widths on both sides of the middle: half the beam, and 0.6 of a width outside it
_ALONG = 2.0 / FINENESS  # widths between neighbouring stations
_PIECE = 1.5  # widths: interval of the spline; a curvature that changes faster is an artefact of the search
_BINS = 12  # in each channel
_BEYOND = 0.6  # widths beyond the end of the strip


@dataclass(frozen=True)
class ColourBins:
    """The bins of a colour histogram, and the bin of each colour in a picture.

    Attributes
    ----------
    index : ndarray of int, shape (n, m)
        Bin of the colour at each of n by m points of the picture.
    shape : tuple of int
        Number of bins in each colour channel.
    """

    index: NDArray[np.int64]
    shape: tuple[int, ...]

    @property
    def total(self) -> int:
        """Number of bins of the histogram: the product of the numbers for the single colour channels."""
        return math.prod(self.shape)


@dataclass(frozen=True)
class UnrolledPicture:
    """The straightened picture of the beam: each of its n rows is read across the beam, at m points.

    Lengths are in widths of the beam in the specimen file, unless px are given.

    Attributes
    ----------
    colours : ndarray, shape (n, m, channels)
        Colours from 0 to 255.
    across : ndarray, shape (m,)
        Coordinates of the columns across the beam; positive to the right as seen from the clamp.
    along : ndarray, shape (n,)
        Distance of each row from the clamp.
    middle : ndarray, shape (n, 2)
        Point of each row on the approximate centre line of the beam, px of the image.
    aside : ndarray, shape (n, 2)
        Vector across the beam whose length is the unit of length, px of the image.
    width : ndarray, shape (n,)
        Approximate width of the beam.
    stated : ndarray, shape (n,)
        Expected width of the beam in the picture: width in the specimen file plus visible side faces.
    inside : ndarray of bool, shape (n, m)
        Whether a point lies in the image and shows no body that crosses the beam.
    covered : ndarray of bool, shape (n, m), optional
        Whether a point shows a body that crosses the beam. None without such a body.
    side_faces : ndarray, shape (2, n) or (2, 1)
        Width of the visible side face of the beam at the left and at the right edge; 0 for a hidden face.
    side_sigma : ndarray, shape (2, n) or (2, 1)
        Standard uncertainty of `side_faces`.
    """

    colours: NDArray[np.float32]
    across: Array
    along: Array
    middle: Array
    aside: Array
    width: Array
    stated: Array
    inside: NDArray[np.bool_]
    covered: NDArray[np.bool_] | None = None
    side_faces: Array = field(default_factory=lambda: np.zeros((2, 1)))
    side_sigma: Array = field(default_factory=lambda: np.zeros((2, 1)))

    @cached_property
    def bins(self) -> ColourBins:
        """Bins of a histogram of all colours."""
        channels = self.colours.shape[2]
        bins = _BINS if channels > 1 else 3 * _BINS
        low, high = np.percentile(self.colours.reshape(-1, channels), (0.5, 99.5), axis=0)
        index = np.clip((self.colours - low) / np.maximum(high - low, 1.0) * bins, 0, bins - 1).astype(np.int64)
        shape = (bins,) * channels
        return ColourBins(np.ravel_multi_index(tuple(np.moveaxis(index, -1, 0)), shape), shape)

    @property
    def stations_in_width(self) -> float:
        """Number of rows of the straightened picture on a length of one width of the beam."""
        return 1.0 / _ALONG


def unroll(fine: WorkingPicture, coarse: WorkingPicture, strip: Strip) -> UnrolledPicture | None:
    """Straighten the picture `fine` of a beam whose approximate path and width, `strip`, are in px of `coarse`.

    Returns
    -------
    UnrolledPicture or None
        None if the strip has fewer than five points.
    """
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
    side_faces, side_sigma = fine.beam.side_faces(middle, wide * normal)
    return UnrolledPicture(
        colours=colours,
        across=across,
        along=along - start,
        middle=begin,
        aside=fine.to_picture(middle + wide * normal) - begin,
        width=width,
        stated=fine.beam.relative_width((along - start) * wide) + side_faces.sum(axis=0),
        inside=inside,
        side_faces=side_faces,
        side_sigma=side_sigma,
    )


def fine_places(points: Array, coarse: WorkingPicture, fine: WorkingPicture) -> Array:
    """Convert points from px of the picture `coarse` to px of the picture `fine`."""
    return fine.from_picture(coarse.to_picture(points))
