"""A frame with what was found on it: the edges, their normals, the corners and the flags; and many on one sheet."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from eimi_lab.config.calibration import Calibration
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edge_set import EdgeSet, Flag
from eimi_lab.vision.intensity import full_scale, grey

LEFT_COLOUR, RIGHT_COLOUR, CORNER_COLOUR = (255, 128, 0), (0, 128, 255), (0, 200, 0)  # blue, green, red
FLAG_COLOUR = (0, 0, 255)
_SUB_PIXEL_BITS = 4
_NORMAL_EVERY = 10  # points
_NORMAL_PX = 8.0  # to both sides
_SHEET_PX = (320, 280)  # width and height of a picture on the sheet, its caption included
_CAPTION_PX = 20
_LETTERS = 0.9 / 1280  # size of a flag's letters for each pixel of the picture's width
_REMEDY_SIZE = 0.75  # of the flag's own letters
_REMEDY_WIDTH = 0.4  # of the picture
_FONT = cv2.FONT_HERSHEY_SIMPLEX


def draw_overlay(image: ArrayLike, edges: EdgeSet, calibration: Calibration) -> NDArray[np.uint8]:
    """(height, width, 3) uint8 picture: left edge blue, right edge orange, corners green, flags in red.

    Every tenth point of an edge shows the normal along which it was sought; each flag its value, its limit and what to
    do about it. image: as for `find_edges`. Raises ValueError for an array that is no image.
    """
    pixels = grey(image)
    shown = np.rint(pixels * (255.0 / full_scale(pixels))).astype(np.uint8)
    picture = cv2.cvtColor(shown, cv2.COLOR_GRAY2BGR)
    frame = BeamFrame(calibration)
    for edge, colour in ((edges.left, LEFT_COLOUR), (edges.right, RIGHT_COLOUR)):
        points = frame.to_px(edge.points_mm)
        cv2.polylines(picture, [_fixed_point(points)], False, colour, 1, cv2.LINE_AA, _SUB_PIXEL_BITS)
        for normal in _normals(points):
            cv2.polylines(picture, [_fixed_point(normal)], False, colour, 1, cv2.LINE_AA, _SUB_PIXEL_BITS)
    radius = 4 << _SUB_PIXEL_BITS
    for corner in _fixed_point(edges.corners_px[np.isfinite(edges.corners_px).all(axis=1)]):
        cv2.circle(picture, tuple(map(int, corner)), radius, CORNER_COLOUR, 1, cv2.LINE_AA, _SUB_PIXEL_BITS)
    _write_flags(picture, edges.flags)
    return np.asarray(picture, dtype=np.uint8)


def _write_flags(picture: NDArray[Any], flags: Sequence[Flag]) -> None:
    """Name, value and limit of each flag in the upper left corner, and its remedy below in smaller letters."""
    size = max(0.4, _LETTERS * picture.shape[1])
    letters = int(_REMEDY_WIDTH * picture.shape[1] / cv2.getTextSize("n", _FONT, _REMEDY_SIZE * size, 1)[0][0])
    base = 0
    for flag in flags:
        headline = f"{flag.name} {flag.value:.3g} (limit {flag.limit:.3g})"
        remedy = textwrap.wrap(flag.remedy, max(20, letters))
        for text, scale in [(headline, size), *((line, _REMEDY_SIZE * size) for line in remedy)]:
            (wide, high), below = cv2.getTextSize(text, _FONT, scale, 1)
            base += high + below + 2
            cv2.rectangle(picture, (8, base - high - 1), (12 + wide, base + below), (255, 255, 255), cv2.FILLED)
            cv2.putText(picture, text, (10, base), _FONT, scale, FLAG_COLOUR, 1, cv2.LINE_AA)
        base += below


def contact_sheet(
    pictures: Sequence[NDArray[np.uint8]], captions: Sequence[str], size_px: tuple[int, int] = _SHEET_PX
) -> NDArray[np.uint8]:
    """One picture of many (height, width, 3), each made small with its caption above, in rows, about square in all.

    size_px: width and height that each gets, its caption included.
    """
    wide, high = size_px
    columns = max(1, math.ceil(math.sqrt(len(pictures))))
    rows = max(1, math.ceil(len(pictures) / columns))
    sheet = np.full((rows * high, columns * wide, 3), 255, dtype=np.uint8)
    for index, (picture, caption) in enumerate(zip(pictures, captions, strict=True)):
        top, left = index // columns * high, index % columns * wide
        share = min(1.0, (wide - 4) / picture.shape[1], (high - _CAPTION_PX - 4) / picture.shape[0])
        size = (max(1, round(picture.shape[1] * share)), max(1, round(picture.shape[0] * share)))
        small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
        begin = top + _CAPTION_PX
        sheet[begin : begin + size[1], left : left + size[0]] = small
        above = sheet[top:begin, left : left + wide - 4]  # alone: a long caption must not run into the next one
        cv2.putText(above, caption, (2, _CAPTION_PX - 6), _FONT, 0.42, (0, 0, 0), 1, cv2.LINE_AA)
    return sheet


def _normals(points: NDArray[Any]) -> NDArray[Any]:
    """(k, 2, 2): short lines across an edge (n, 2) at every tenth point."""
    if len(points) < 3:
        return np.zeros((0, 2, 2))
    tangent = np.gradient(points, axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    across = _NORMAL_PX * np.column_stack([-tangent[:, 1], tangent[:, 0]])
    return np.stack([points - across, points + across], axis=1)[::_NORMAL_EVERY]


def _fixed_point(points: NDArray[Any]) -> NDArray[np.int32]:
    """Places for OpenCV's sub-pixel drawing, kept within what it can hold."""
    return np.rint(np.clip(points, -1e5, 1e5) * 2**_SUB_PIXEL_BITS).astype(np.int32)
