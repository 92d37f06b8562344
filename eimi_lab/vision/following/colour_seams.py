"""Find both edges in the straightened picture of the beam; each edge has its own weighted sum of the colours."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.following.discriminant import BODY_BAND, INSIDE_BAND, ColourProjection, project
from eimi_lab.vision.following.seams import ARM, CHROMA_ARM, fall_across, find_seams
from eimi_lab.vision.following.unrolled import UnrolledPicture

Array = NDArray[np.float64]

OUTWARD = (-1.0, 1.0)


@dataclass(frozen=True)
class Seams:
    """The left and the right edge in each of the n rows of the straightened picture of the beam.

    Each row of this picture crosses the beam. Lengths are in widths of the beam.

    Attributes
    ----------
    edge : ndarray, shape (2, n)
        Position of the left edge (row 0) and of the right edge (row 1) across the beam.
    support : ndarray, shape (2, n)
        Change of colour at the edge, from 0 to 1; 1 is a full step from the inside to the outside colour.
    projected : tuple of ColourProjection
        For each edge, the weighted sum of the colours that shows it.
    shadow : ndarray, shape (2, n)
        Distance between an edge and the border of a possible shadow of the beam; 0 without such a border.
    """

    edge: Array
    support: Array
    projected: tuple[ColourProjection, ColourProjection]
    shadow: Array


def find_colour_seams(
    unrolled: UnrolledPicture, edge: Array, noise: float, tolerances: Iterable[float], shadowless: bool = False
) -> Seams:
    """Find both edges in the straightened picture of the beam.

    Parameters
    ----------
    unrolled : UnrolledPicture
        The straightened picture.
    edge : ndarray, shape (2, n)
        Expected positions of the left and the right edge across the beam, in widths of the beam.
    noise : float
        Standard deviation of the noise, grey levels (0 to 255).
    tolerances : iterable of float
        Standard deviation of the prior of an edge's position in each of several searches, in widths of the beam. The
        prior mean is ``edge`` in the first search, then the result of the previous search.
    shadowless : bool
        Whether to use only weighted sums of the colours in which a shadow is invisible.
    """
    for number, tolerance in enumerate(tolerances):
        band = BODY_BAND if shadowless and number == 0 else INSIDE_BAND
        left, right = (project(unrolled, *side, noise, shadowless, band) for side in zip(edge, OUTWARD, strict=True))
        sides = zip((left, right), OUTWARD, strict=True)
        in_width, arm = unrolled.stations_in_width, CHROMA_ARM if shadowless else ARM
        fall = np.stack([fall_across(side.share, outward, unrolled.across, in_width, arm) for side, outward in sides])
        edge = find_seams(fall, unrolled.across, edge, tolerance)
    column = np.rint((edge - unrolled.across[0]) / (unrolled.across[1] - unrolled.across[0])).astype(int)
    rows = np.arange(edge.shape[1])
    support = np.where(unrolled.inside[rows, column], fall[[[0], [1]], rows, column], 0.0)
    return Seams(edge, np.clip(support, 0.0, 1.0), (left, right), np.zeros(edge.shape))
