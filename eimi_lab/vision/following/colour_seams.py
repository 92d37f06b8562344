"""Both edges of the unrolled strip as seams, each in the projection of colour in which its two sides differ most."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.following.discriminant import ColourProjection, project
from eimi_lab.vision.following.seams import fall_across, find_seams
from eimi_lab.vision.following.unrolled import UnrolledPicture

Array = NDArray[np.float64]

OUTWARD = (-1.0, 1.0)


@dataclass(frozen=True)
class Seams:
    """Both edges, left and right, at n stations.

    edge: (2, n) places across, widths. support: (2, n) 0 to 1 how much of a whole edge falls there. shadow: (2, n)
    widths by which an edge was moved off the border of a shadow; 0 where it stayed.
    """

    edge: Array
    support: Array
    projected: tuple[ColourProjection, ColourProjection]
    shadow: Array


def find_colour_seams(
    unrolled: UnrolledPicture, edge: Array, noise: float, tolerances: Iterable[float], shadowless: bool = False
) -> Seams:
    """Both seams in passes that each take what is inside and outside from the one before, first from ``edge`` (2, n).

    tolerances: of each pass, widths by which an edge may be off the one before. shadowless: only in projections in
    which what is beside the beam looks the same in shadow.
    """
    for tolerance in tolerances:
        left, right = (project(unrolled, *side, noise, shadowless) for side in zip(edge, OUTWARD, strict=True))
        sides = zip((left, right), OUTWARD, strict=True)
        in_width = unrolled.stations_in_width
        fall = np.stack([fall_across(side.share, outward, unrolled.across, in_width) for side, outward in sides])
        edge = find_seams(fall, unrolled.across, edge, tolerance)
    column = np.rint((edge - unrolled.across[0]) / (unrolled.across[1] - unrolled.across[0])).astype(int)
    rows = np.arange(edge.shape[1])
    support = np.where(unrolled.inside[rows, column], fall[[[0], [1]], rows, column], 0.0)
    return Seams(edge, np.clip(support, 0.0, 1.0), (left, right), np.zeros(edge.shape))
