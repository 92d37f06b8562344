"""A frame with what was found on it: the edges, the corners and the flags."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from eimi_lab.config.calibration import Calibration
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edge_set import EdgeSet
from eimi_lab.vision.intensity import full_scale, grey

LEFT_COLOUR, RIGHT_COLOUR, CORNER_COLOUR = (255, 128, 0), (0, 128, 255), (0, 200, 0)  # blue, green, red
FLAG_COLOUR = (0, 0, 255)
_SUB_PIXEL_BITS = 4
_FONT = cv2.FONT_HERSHEY_SIMPLEX


def draw_overlay(image: ArrayLike, edges: EdgeSet, calibration: Calibration) -> NDArray[np.uint8]:
    """(height, width, 3) uint8 picture: left edge blue, right edge orange, corners green, a red line for each flag.

    image: as for `find_edges`. Raises ValueError for an array that is no image.
    """
    pixels = grey(image)
    shown = np.rint(pixels * (255.0 / full_scale(pixels))).astype(np.uint8)
    picture = cv2.cvtColor(shown, cv2.COLOR_GRAY2BGR)
    frame = BeamFrame(calibration)
    for edge, colour in ((edges.left, LEFT_COLOUR), (edges.right, RIGHT_COLOUR)):
        line = _fixed_point(frame.to_px(edge.points_mm))
        cv2.polylines(picture, [line], False, colour, 1, cv2.LINE_AA, _SUB_PIXEL_BITS)
    radius = 4 << _SUB_PIXEL_BITS
    for corner in _fixed_point(edges.corners_px[np.isfinite(edges.corners_px).all(axis=1)]):
        cv2.circle(picture, tuple(map(int, corner)), radius, CORNER_COLOUR, 1, cv2.LINE_AA, _SUB_PIXEL_BITS)
    for row, flag in enumerate(edges.flags):
        text, base = f"{flag.name} {flag.value:.3g} (limit {flag.limit:.3g})", 24 * (row + 1)
        (wide, high), below = cv2.getTextSize(text, _FONT, 0.6, 1)
        cv2.rectangle(picture, (8, base - high), (12 + wide, base + below), (255, 255, 255), cv2.FILLED)
        cv2.putText(picture, text, (10, base), _FONT, 0.6, FLAG_COLOUR, 1, cv2.LINE_AA)
    return np.asarray(picture, dtype=np.uint8)


def _fixed_point(points: NDArray[Any]) -> NDArray[np.int32]:
    """Places for OpenCV's sub-pixel drawing, kept within what it can hold."""
    return np.rint(np.clip(points, -1e5, 1e5) * 2**_SUB_PIXEL_BITS).astype(np.int32)
