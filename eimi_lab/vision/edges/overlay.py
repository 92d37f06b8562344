"""Draw the edges of the beam and the failed quality checks (flags) on a frame."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from eimi_lab.config.calibration import Calibration
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.check import Flag, Severity
from eimi_lab.vision.edges.edge_set import EdgeSet
from eimi_lab.vision.following.follow import FollowedBeam
from eimi_lab.vision.intensity import eight_bit, full_scale

LEFT_COLOUR, RIGHT_COLOUR, CORNER_COLOUR = (255, 128, 0), (0, 128, 255), (0, 200, 0)  # blue, green, red
FLAG_COLOUR = (0, 0, 255)
NOTE_COLOUR = (96, 96, 96)
STATED_COLOUR, FOLLOWED_COLOUR = (255, 220, 80), (0, 230, 255)  # light blue, yellow
_SUB_PIXEL_BITS = 4
_NORMAL_EVERY = 10  # points
_NORMAL_PX = 8.0  # on both sides of the edge
_SHEET_PX = (320, 280)  # width and height of a picture on the sheet, its caption included
_CAPTION_PX = 20
_LETTERS = 0.9 / 1280  # size of a flag's letters for each pixel of the picture's width
_REMEDY_SIZE = 0.75  # of the flag's own letters
_LEAST_TEXT_PX = 560  # least width of the text below a small picture
_FONT = cv2.FONT_HERSHEY_SIMPLEX


def draw_overlay(
    image: ArrayLike,
    edges: EdgeSet,
    calibration: Calibration,
    specimen_file: SpecimenFile | None = None,
    followed: FollowedBeam | None = None,
) -> NDArray[np.uint8]:
    """Draw the edges on the picture of the beam, and list the failed quality checks (flags) below it.

    The left edge is blue, the right edge is orange, and the corners are green.

    Parameters
    ----------
    image : array_like, shape (rows, columns) or (rows, columns, 3)
        The picture.
    edges : EdgeSet
        The edges and flags.
    calibration : Calibration
        The map between millimetres and pixels.
    specimen_file : SpecimenFile, optional
        If there are no edges, a straight beam of this length and width is drawn in light blue.
    followed : FollowedBeam, optional
        If there are no edges and `specimen_file` is given, this followed path is drawn in yellow.

    Returns
    -------
    ndarray of uint8, shape (h, w, 3)
        The drawing of height h and width w; blue, green, red.

    Raises
    ------
    ValueError
        If the array is not an image.
    """
    picture = in_colour(image)
    frame = BeamFrame(calibration)
    if specimen_file is not None and not len(edges.left.points_mm):
        _draw_stated(picture, frame, specimen_file)
        if followed is not None:
            _draw_followed(picture, followed)
    for edge, colour in ((edges.left, LEFT_COLOUR), (edges.right, RIGHT_COLOUR)):
        points = frame.to_px(edge.points_mm)
        _draw_line(picture, points, colour)
        for normal in _normals(points):
            _draw_line(picture, normal, colour)
    radius = 4 << _SUB_PIXEL_BITS
    for corner in _fixed_point(edges.corners_px[np.isfinite(edges.corners_px).all(axis=1)]):
        cv2.circle(picture, tuple(map(int, corner)), radius, CORNER_COLOUR, 1, cv2.LINE_AA, _SUB_PIXEL_BITS)
    return _with_words_below(picture, edges.flags)


def in_colour(image: ArrayLike) -> NDArray[np.uint8]:
    """Convert an image of any kind to colours of 8 bits, shape (rows, columns, 3)."""
    pixels = np.asarray(image)
    if pixels.ndim != 3:
        return np.asarray(cv2.cvtColor(eight_bit(image), cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    shown = np.nan_to_num(pixels[..., :3].astype(np.float32))
    return np.clip(np.rint(shown * (255.0 / full_scale(shown))), 0, 255).astype(np.uint8)


def _draw_line(picture: NDArray[np.uint8], points: NDArray[Any], colour: tuple[int, int, int]) -> None:
    cv2.polylines(picture, [_fixed_point(points)], False, colour, 1, cv2.LINE_AA, _SUB_PIXEL_BITS)


def _draw_stated(picture: NDArray[np.uint8], frame: BeamFrame, specimen_file: SpecimenFile) -> None:
    length, half = specimen_file.specimen.length_mm, 0.5 * specimen_file.specimen.width_mm
    for line in (
        [[0.0, -2.0 * half], [0.0, 2.0 * half]],
        [[0.0, 0.0], [length, 0.0]],
        [[0.0, -half], [length, -half]],
        [[0.0, half], [length, half]],
    ):
        _draw_line(picture, frame.to_px(line), STATED_COLOUR)


def _draw_followed(picture: NDArray[np.uint8], followed: FollowedBeam) -> None:
    """Draw a followed path with a cross at its end, and the reliable points of both edges."""
    path = followed.path_px
    _draw_line(picture, path, FOLLOWED_COLOUR)
    for edge in followed.sure_px:
        for place in _fixed_point(edge):
            cv2.circle(picture, tuple(map(int, place)), 1 << _SUB_PIXEL_BITS, FOLLOWED_COLOUR, -1, 8, _SUB_PIXEL_BITS)
    if len(path):
        end = tuple(map(int, np.rint(path[-1])))
        cv2.drawMarker(picture, end, FLAG_COLOUR, cv2.MARKER_TILTED_CROSS, 20, 2, cv2.LINE_AA)


def _with_words_below(picture: NDArray[np.uint8], flags: Sequence[Flag]) -> NDArray[np.uint8]:
    """Add the name, value, limit and advice of each failed quality check below the picture."""
    if not flags:
        return picture
    wide = max(picture.shape[1], _LEAST_TEXT_PX)
    size = max(0.4, _LETTERS * wide)
    letters = int((wide - 20) / (cv2.getTextSize("n" * 20, _FONT, _REMEDY_SIZE * size, 1)[0][0] / 20))
    lines: list[tuple[str, float, tuple[int, int, int]]] = []
    for flag in flags:
        colour = NOTE_COLOUR if flag.severity is Severity.NOTE else FLAG_COLOUR
        lines.append((f"{flag.name} {flag.value:.3g} (limit {flag.limit:.3g}), {flag.severity}", size, colour))
        lines += [(line, _REMEDY_SIZE * size, colour) for line in textwrap.wrap(flag.remedy, letters)]
    high = int(1.8 * cv2.getTextSize("Ag", _FONT, size, 1)[0][1]) + 2
    below = np.full((high * len(lines) + 8, wide, 3), 255, dtype=np.uint8)
    for row, (text, scale, colour) in enumerate(lines):
        cv2.putText(below, text, (10, (row + 1) * high - 2), _FONT, scale, colour, 1, cv2.LINE_AA)
    filled = cv2.copyMakeBorder(picture, 0, 0, 0, wide - picture.shape[1], cv2.BORDER_CONSTANT, value=(255, 255, 255))
    return np.asarray(np.vstack([filled, below]), dtype=np.uint8)


def contact_sheet(
    pictures: Sequence[NDArray[np.uint8]], captions: Sequence[str], size_px: tuple[int, int] = _SHEET_PX
) -> NDArray[np.uint8]:
    """Combine pictures with captions on one roughly square sheet.

    Parameters
    ----------
    pictures : sequence of ndarray of uint8, shape (h, w, 3)
        Pictures of height h and width w; large pictures are reduced.
    captions : sequence of str
        A caption above each picture.
    size_px : tuple of int
        Width and height of the space for one picture and its caption.

    Returns
    -------
    ndarray of uint8, shape (rows, columns, 3)
        The sheet, with the order of colours of the pictures.
    """
    wide, high = size_px
    columns = max(1, math.ceil(math.sqrt(len(pictures))))
    rows = max(1, math.ceil(len(pictures) / columns))
    sheet = np.full((rows * high, columns * wide, 3), 255, dtype=np.uint8)
    for index, (picture, caption) in enumerate(zip(pictures, captions, strict=True)):
        top, left = index // columns * high, index % columns * wide
        reduction = min(1.0, (wide - 4) / picture.shape[1], (high - _CAPTION_PX - 4) / picture.shape[0])
        size = (max(1, round(picture.shape[1] * reduction)), max(1, round(picture.shape[0] * reduction)))
        small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
        begin = top + _CAPTION_PX
        sheet[begin : begin + size[1], left : left + size[0]] = small
        above = sheet[top:begin, left : left + wide - 4]  # a part of the sheet, so that a long caption is cut off
        cv2.putText(above, caption, (2, _CAPTION_PX - 6), _FONT, 0.42, (0, 0, 0), 1, cv2.LINE_AA)
    return sheet


def _normals(points: NDArray[Any]) -> NDArray[Any]:
    if len(points) < 3:
        return np.zeros((0, 2, 2))
    tangent = np.gradient(points, axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-12)
    across = _NORMAL_PX * np.column_stack([-tangent[:, 1], tangent[:, 0]])
    return np.stack([points - across, points + across], axis=1)[::_NORMAL_EVERY]


def _fixed_point(points: NDArray[Any]) -> NDArray[np.int32]:
    """Convert points to the fixed-point integers of OpenCV's sub-pixel drawing."""
    return np.rint(np.clip(points, -1e5, 1e5) * 2**_SUB_PIXEL_BITS).astype(np.int32)
