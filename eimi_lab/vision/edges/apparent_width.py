"""Measure the width of the beam near its clamp from grey values."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edges.profiles import sample

_FROM, _TO, _LINES = 0.1, 0.3, 9  # of the length: beyond the clamp's shadow, and before the beam bends away
_HALF = 0.5  # of the length: reach of the lines on each side of the axis
_POINTS = 1201  # of each line


def apparent_width_mm(image: NDArray[Any], frame: BeamFrame, length_mm: float) -> float | None:
    """Return the width (mm) of the body that lies on the beam's axis near the clamp.

    Parameters
    ----------
    image : ndarray, shape (rows, columns)
        Grey values.
    frame : BeamFrame
        Scale, clamp and axis.
    length_mm : float
        Length of the specimen.

    Returns
    -------
    float or None
        None if a side of the body is not found.
    """
    x = length_mm * np.linspace(_FROM, _TO, _LINES)
    y = _HALF * length_mm * np.linspace(-1.0, 1.0, _POINTS)
    places = frame.to_px(np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)).reshape(_LINES, _POINTS, 2)
    height, width = image.shape
    inside = np.all((places >= 0) & (places <= [width - 1, height - 1]), axis=-1)
    grey = np.where(inside, sample(image, places.reshape(-1, 2)).reshape(_LINES, _POINTS), np.nan)
    middle = _POINTS // 2
    middle_grey = 0.5 * (np.nanpercentile(grey, 5) + np.nanpercentile(grey, 95))
    like_axis: NDArray[np.bool_] = (grey > middle_grey) == (np.median(grey[:, middle]) > middle_grey)
    widths = []
    for row, in_image in zip(like_axis, inside, strict=True):
        ends = np.flatnonzero(~row | ~in_image)
        below, above = ends[ends < middle], ends[ends > middle]
        if not row[middle] or not len(below) or not len(above) or not (in_image[below[-1]] and in_image[above[0]]):
            return None
        widths.append((above[0] - below[-1] - 1) * (y[1] - y[0]))
    return float(np.median(widths))
