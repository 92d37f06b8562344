"""Draw a grid of pixel coordinates and a compass of angles on a frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.intensity import full_scale

MARGIN_PX = 46  # around the frame, for the numbers
_LINES = 12  # approximate number of grid lines along the longer side
_INK, _PAPER, _RULE, _LINE = (0, 0, 0), (255, 255, 255), (0, 200, 255), (255, 0, 255)
SUGGESTED = (0, 170, 0)
"""Blue, green and red of suggested lines."""
_FONT, _LETTERS = cv2.FONT_HERSHEY_SIMPLEX, 0.42
_COMPASS_PX = 34


def ruled_picture(
    image: NDArray[Any], lines: Sequence[NDArray[np.float64]] = (), suggested: Sequence[NDArray[np.float64]] = ()
) -> NDArray[np.uint8]:
    """Draw a grid of pixel coordinates over a frame, with a compass of angles beside it.

    Parameters
    ----------
    image : ndarray, shape (rows, columns) or (rows, columns, 3)
        The frame; blue, green, red.
    lines : sequence of ndarray, shape (n, 2)
        Lines to draw in magenta, px of the frame.
    suggested : sequence of ndarray, shape (n, 2)
        Lines to draw in green, px of the frame.

    Returns
    -------
    ndarray of uint8, shape (rows + margins, columns + margins, 3)
        The picture; pixel (0, 0) of the frame lies at (MARGIN_PX, MARGIN_PX).
    """
    shown = image if image.ndim == 3 else np.repeat(image[..., None], 3, axis=2)
    shown = np.rint(shown * (255.0 / full_scale(shown))).astype(np.uint8)
    height, width = shown.shape[:2]
    bottom = 2 * _COMPASS_PX + 2 * MARGIN_PX
    sheet = cv2.copyMakeBorder(shown, MARGIN_PX, bottom, MARGIN_PX, MARGIN_PX, cv2.BORDER_CONSTANT, value=_PAPER)
    step = _round_step(max(width, height) / _LINES)
    for x in range(0, width, step):
        _rule(sheet, (MARGIN_PX + x, MARGIN_PX), (MARGIN_PX + x, MARGIN_PX + height - 1))
        _write(sheet, str(x), (MARGIN_PX + x, MARGIN_PX // 2))
    for y in range(0, height, step):
        _rule(sheet, (MARGIN_PX, MARGIN_PX + y), (MARGIN_PX + width - 1, MARGIN_PX + y))
        _write(sheet, str(y), (MARGIN_PX // 2, MARGIN_PX + y))
    for line, colour in [(line, _LINE) for line in lines] + [(line, SUGGESTED) for line in suggested]:
        drawn = np.rint(np.clip(line, -1e4, 1e5) + MARGIN_PX).astype(np.int32)
        cv2.polylines(sheet, [drawn], False, colour, 2, cv2.LINE_AA)
    _compass(sheet, (MARGIN_PX + _COMPASS_PX + 10, MARGIN_PX + height + _COMPASS_PX + 40))
    return np.asarray(sheet, dtype=np.uint8)


def _round_step(least: float) -> int:
    """Return the distance of grid lines: the smallest of 1, 2, 5, 10, 20, 50, ... that is not below `least`."""
    power = 10 ** math.floor(math.log10(max(least, 1.0)))
    return int(next(power * factor for factor in (1, 2, 5, 10) if power * factor >= least))


def _rule(sheet: NDArray[Any], begin: tuple[int, int], end: tuple[int, int]) -> None:
    part = sheet[begin[1] : end[1] + 1, begin[0] : end[0] + 1]
    part[:] = (0.6 * part + 0.4 * np.array(_RULE)).astype(np.uint8)


def _write(sheet: NDArray[Any], text: str, middle: tuple[int, int]) -> None:
    (wide, high), _ = cv2.getTextSize(text, _FONT, _LETTERS, 1)
    cv2.putText(sheet, text, (middle[0] - wide // 2, middle[1] + high // 2), _FONT, _LETTERS, _INK, 1, cv2.LINE_AA)


def _compass(sheet: NDArray[Any], middle: tuple[int, int]) -> None:
    """Draw arrows to the right, down, left and up, labelled with angles in degrees."""
    for angle in (0, 90, 180, -90):
        direction = np.array([math.cos(math.radians(angle)), math.sin(math.radians(angle))])
        end = np.rint(np.array(middle) + _COMPASS_PX * 0.7 * direction).astype(int)
        cv2.arrowedLine(sheet, middle, tuple(map(int, end)), _INK, 1, cv2.LINE_AA, tipLength=0.3)
        place = np.rint(np.array(middle) + _COMPASS_PX * direction).astype(int)
        _write(sheet, str(angle), (int(place[0]), int(place[1])))
