"""Measure the direction of gravity on a picture of a plumb line, a thread with a weight."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_lab.config.calibration import Calibration
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.intensity import eight_bit

Array = NDArray[np.float64]

_WIDEST = 1 / 12  # of the picture's shorter side; a wider body is not a thread
_SHORTEST = 1 / 3  # of the picture's shorter side; a shorter body is not a thread
_SLENDER = 20.0  # least length over mean width
_LEAST_DARKNESS = 20  # of 255
_HALF_WINDOW_PX = 3  # around the thread's own pixels, for its blurred flanks
_STRETCHES = 12
_ROUNDS = 3


@dataclass(frozen=True)
class PlumbLine:
    """The direction of gravity from a plumb line in an image.

    Attributes
    ----------
    gravity_angle_deg : float
        Direction of gravity, clockwise from +x of the image.
    gravity_angle_sigma_deg : float
        Standard deviation of this direction.
    residual_px : float
        RMS distance of the thread from a straight line.
    """

    gravity_angle_deg: float
    gravity_angle_sigma_deg: float
    residual_px: float


def measure_plumb_line(image: NDArray[Any], calibration: Calibration, roughly_deg: float) -> PlumbLine:
    """Measure the direction of gravity on an image of a thread with a weight.

    Parameters
    ----------
    image : ndarray, shape (rows, columns) or (rows, columns, 3)
        The dark thread in front of the back-light.
    calibration : Calibration
        The lens and the axis.
    roughly_deg : float
        Approximate direction of gravity.

    Returns
    -------
    PlumbLine
        The direction of gravity with its standard deviation.

    Raises
    ------
    ValueError
        If the image shows no thin dark line, or if the thread is more than 1 px (RMS) off a straight line.
    """
    middle = _thread(image)
    frame = BeamFrame(calibration)
    points = frame.to_mm(middle) * calibration.pixels_per_mm
    for _ in range(_ROUNDS):
        centre = points.mean(axis=0)
        along = np.linalg.svd(points - centre, full_matrices=False)[2][0]
        aside = (points - centre) @ np.array([-along[1], along[0]])
        points = points[np.abs(aside) <= max(3.0 * 1.4826 * float(np.median(np.abs(aside))), 0.05)]
    centre = points.mean(axis=0)
    along = np.linalg.svd(points - centre, full_matrices=False)[2][0]
    place, aside = (points - centre) @ along, (points - centre) @ np.array([-along[1], along[0]])
    order = np.argsort(place)
    means = np.array([[place[part].mean(), aside[part].mean()] for part in np.array_split(order, _STRETCHES)])
    slope, covariance = np.polyfit(means[:, 0], means[:, 1], 1, cov=True)
    turned = math.degrees(math.atan2(along[1], along[0]) + math.atan(slope[0]))
    angle = calibration.axis_angle_deg + frame.hand * turned
    away = (angle - roughly_deg + 90.0) % 180.0 - 90.0
    residual = float(np.sqrt((aside**2).mean()))
    if residual > 1.0:
        raise ValueError(
            f"the thread is {residual:.1f} px off a straight line (RMS); it should hang free and be at rest"
        )
    return PlumbLine(roughly_deg + away, math.degrees(math.sqrt(covariance[0, 0])), residual)


def _thread(image: NDArray[Any]) -> Array:
    """Return points along the middle of the longest thin dark body, px, shape (n, 2)."""
    shown = eight_bit(image)
    side = min(shown.shape)
    if side < 100:
        raise ValueError(f"the picture is too small: its shorter side is {side} px long and should be at least 100 px")
    widest = max(9, round(_WIDEST * side)) | 1
    darkness = cv2.morphologyEx(shown, cv2.MORPH_BLACKHAT, np.ones((widest, widest), np.uint8))
    level, mask = cv2.threshold(darkness, 0, 1, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    _, labels, statistics, _ = cv2.connectedComponentsWithStats(mask)
    extent = np.hypot(statistics[:, cv2.CC_STAT_WIDTH], statistics[:, cv2.CC_STAT_HEIGHT])
    slender = extent**2 > _SLENDER * statistics[:, cv2.CC_STAT_AREA]
    slender[0] = False  # the background
    body = int(np.argmax(np.where(slender, extent, 0.0)))
    if level < _LEAST_DARKNESS or not slender[body] or extent[body] < _SHORTEST * side:
        raise ValueError(
            "shows no dark thread that is a third of the picture long; hang a thread in front of the back-light"
        )
    y, x = np.nonzero(cv2.dilate((labels == body).astype(np.uint8), np.ones((2 * _HALF_WINDOW_PX + 1,) * 2, np.uint8)))
    core_y, core_x = np.nonzero(labels == body)
    down = np.ptp(core_y) > np.ptp(core_x)
    along, across = (y, x) if down else (x, y)
    core = core_y if down else core_x
    first = int(core.min())
    inside = (along >= first) & (along <= int(core.max()))
    bins, weight = along[inside] - first, darkness[y, x][inside].astype(np.float64)
    total = np.bincount(bins, weight)
    middle = np.bincount(bins, weight * across[inside]) / np.maximum(total, 1e-9)
    width = np.bincount(core - first)
    thread = (width > 0) & (width <= 1.5 * np.median(width)) & (total > 0.0)  # a bob or a knot is wider
    margin = _HALF_WINDOW_PX + 2  # the window cuts the two ends obliquely
    thread[:margin] = thread[-margin:] = False
    if thread.sum() < _SHORTEST * side:
        raise ValueError(
            "shows no dark thread that is a third of the picture long; hang a thread in front of the back-light"
        )
    place = np.arange(first, first + len(width), dtype=np.float64)[thread]
    return np.column_stack([middle[thread], place] if down else [place, middle[thread]])
