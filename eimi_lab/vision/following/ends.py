"""The ends of the edges: their last points count where the beam is as wide as before.

Near the tip and near the clamp the border of a shadow, or what is behind, may take over from an edge. It leaves it
slowly at first, so that no single point is an outlier, and a spline through all of them follows.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.edges.dimensions import local_widths
from eimi_lab.vision.following.edge_points import StripEdges, with_scatter

Array = NDArray[np.float64]

_END = 0.8  # widths: the stretch that is asked for,
_BASE = 3.0  # and the one before it, whose width goes on
_FEWEST = 6  # points of that
_CERTAIN = 4.0  # standard deviations of the width
_NEAR = 0.025  # widths: what is so near is no other edge
_NORMAL_MEDIAN = 1.4826


def as_wide_at_ends(left: StripEdges, right: StripEdges, width_px: float) -> tuple[StripEdges, StripEdges]:
    """Both edges without the points at either end from which on the beam is clearly wider or narrower than before."""
    kept = []
    for own, other in ((left, right), (right, left)):
        widths = local_widths(own.points, other.points) / width_px
        begin = _toward_last(own.along[::-1], widths[::-1])[::-1]
        kept.append(begin & _toward_last(own.along, widths))
    one, two = (_without(edge, keep) for edge, keep in zip((left, right), kept, strict=True))
    return one, two


def _without(edge: StripEdges, kept: NDArray[np.bool_]) -> StripEdges:
    """The edge with some of its points, and the scatter that is theirs."""
    if kept.all() or kept.sum() < _FEWEST:
        return edge
    points, sigma, near = with_scatter(edge.points[kept], edge.sigma[kept])
    return replace(edge, points=points[near], sigma=sigma[near], along=edge.along[kept][near])


def _toward_last(along: Array, widths: Array) -> NDArray[np.bool_]:
    """(n,) which places along an edge, in widths, are before the one from which on the beam's width is another."""
    kept = np.ones(len(along), dtype=bool)
    to_end = np.abs(along[-1] - along)
    end = to_end < _END
    base = ~end & (to_end < _END + _BASE)
    if base.sum() < _FEWEST:
        return kept
    slope, level = np.polyfit(along[base], widths[base], 1)
    off = np.abs(widths - level - slope * along)
    usual = _NORMAL_MEDIAN * float(np.median(off[base]))
    other = end & (off > max(_NEAR, _CERTAIN * usual))
    if other.any():
        kept[int(other.argmax()) :] = False
    return kept
