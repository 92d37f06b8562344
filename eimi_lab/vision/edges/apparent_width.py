"""How wide the beam is in a picture near its clamp, by grey values alone and whatever its files say."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edges.profiles import sample

_FROM, _TO, _LINES = 0.1, 0.3, 9  # of the length: beyond the clamp's shadow, before the beam bends away
_HALF = 0.5  # of the length, that is looked at to both sides
_POINTS = 1201


def apparent_width_mm(image: NDArray[Any], frame: BeamFrame, length_mm: float) -> float | None:
    """The median width of what lies on the beam's axis in a grey image (H, W); None where it has no end in it.

    The beam is what has the axis's own grey value, as against the other end of the grey values beside it.
    """
    x = length_mm * np.linspace(_FROM, _TO, _LINES)
    y = _HALF * length_mm * np.linspace(-1.0, 1.0, _POINTS)
    places = frame.to_px(np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)).reshape(_LINES, _POINTS, 2)
    height, width = image.shape
    inside = np.all((places >= 0) & (places <= [width - 1, height - 1]), axis=-1)
    grey = np.where(inside, sample(image, places.reshape(-1, 2)).reshape(_LINES, _POINTS), np.nan)
    middle = _POINTS // 2
    half_way = 0.5 * (np.nanpercentile(grey, 5) + np.nanpercentile(grey, 95))
    alike: NDArray[np.bool_] = (grey > half_way) == (np.median(grey[:, middle]) > half_way)
    widths = []
    for row, seen in zip(alike, inside, strict=True):
        ends = np.flatnonzero(~row | ~seen)
        below, above = ends[ends < middle], ends[ends > middle]
        if not row[middle] or not len(below) or not len(above) or not (seen[below[-1]] and seen[above[0]]):
            return None
        widths.append((above[0] - below[-1] - 1) * (y[1] - y[0]))
    return float(np.median(widths))
