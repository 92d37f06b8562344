"""Remove the points at the ends of the edges where the width of the beam changes abruptly.

Near the clamp and near the tip, the located points may follow the border of a shadow or of another body.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.edges.dimensions import local_widths
from eimi_lab.vision.following.edge_points import StripEdges, estimate_scatter

Array = NDArray[np.float64]

_END = 0.8  # widths: the stretch at the end that is examined
_BASE = 3.0  # widths: the stretch before it, whose width is extrapolated
_FEWEST = 6  # points in that stretch
_CERTAIN = 4.0  # standard deviations of the width: a clear difference
_NEAR = 0.025  # widths: a smaller difference is not another edge
_NORMAL_MEDIAN = 1.4826  # standard deviation of a normal distribution over its median absolute value


def trim_ends(
    left: StripEdges, right: StripEdges, width_px: float, stated: Callable[[Array], Array] = np.ones_like
) -> tuple[StripEdges, StripEdges]:
    """Remove the points near the clamp and near the tip where the width of the beam clearly changes.

    Parameters
    ----------
    left, right : StripEdges
        The located edges.
    width_px : float
        Width of the beam according to the specimen file.
    stated : callable
        Takes distances from the clamp and returns the expected widths there, both in widths of the beam. By default,
        the width is constant.

    Returns
    -------
    left, right : StripEdges
        The edges without the removed points.
    """
    kept = []
    for edge, other_edge in ((left, right), (right, left)):
        widths = local_widths(edge.points, other_edge.points) / (width_px * stated(edge.along))
        begin = _as_wide_toward_last(edge.along[::-1], widths[::-1])[::-1]
        kept.append(begin & _as_wide_toward_last(edge.along, widths))
    one, two = (_without(edge, keep) for edge, keep in zip((left, right), kept, strict=True))
    return one, two


def _without(edge: StripEdges, kept: NDArray[np.bool_]) -> StripEdges:
    if kept.all() or kept.sum() < _FEWEST:
        return edge
    points, sigma, near = estimate_scatter(edge.points[kept], edge.sigma[kept])
    return replace(edge, points=points[near], sigma=sigma[near], along=edge.along[kept][near])


def _as_wide_toward_last(along: Array, widths: Array) -> NDArray[np.bool_]:
    """Return which points of an edge come before an abrupt change of the beam's width near its end; all without one."""
    kept = np.ones(len(along), dtype=bool)
    to_end = np.abs(along[-1] - along)
    end = to_end < _END
    base = ~end & (to_end < _END + _BASE)
    if base.sum() < _FEWEST:
        return kept
    line, parabola = (np.polyval(np.polyfit(along[base], widths[base], degree), along) for degree in (1, 2))
    # A body whose width changes smoothly, such as an inflated one, lies between the two continuations.
    # The border of another body leaves the edge slowly at first: no single point is an outlier of a spline through all
    # points.
    excess = np.maximum(widths - np.maximum(line, parabola), np.minimum(line, parabola) - widths)
    deviation = np.where(end, np.maximum(excess, 0.0), np.abs(widths - line))
    scatter = _NORMAL_MEDIAN * float(np.median(deviation[base]))
    differs = end & (deviation > max(_NEAR, _CERTAIN * scatter))
    if differs.any():
        kept[int(differs.argmax()) :] = False
    return kept
