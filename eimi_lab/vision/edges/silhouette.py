"""Find the outline of the beam and the corners of its tip, accurate to about a pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray

from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edges.clamp_line import ClampLine
from eimi_lab.vision.edges.profiles import sample
from eimi_lab.vision.edges.stated_shape import StatedShape

Array = NDArray[np.float64]

_SHRINK = 16  # the back-light is smooth: its surface is fitted to an image that is smaller by this factor
_REACH = 2.0  # beam lengths around the clamp that are searched; a loaded beam may be longer than at rest
_CORNER_ARM = 0.35  # of the beam's width: the turn at a corner is measured over this length on both sides
_PLACES_IN_WIDTH = 40  # places in a beam width at which the turn is measured
_LEAST_TURN_DEG = 30.0
_PARENT = 3  # column of OpenCV's contour hierarchy that holds the index of the enclosing contour


@dataclass(frozen=True)
class BackLight:
    """The brightness of the back-light around the beam.

    Attributes
    ----------
    surface : ndarray
        Fitted grey values of the back-light on a coarse grid over the image.
    bright : float
        Fitted grey value of the back-light at the clamp.
    dark : float
        Grey value of the beam at its clamp; at most `bright`.
    """

    surface: NDArray[np.float32]
    bright: float
    dark: float


@dataclass(frozen=True)
class Silhouette:
    """The outline of the beam, from the clamp along the left edge, around the tip and back along the right edge.

    Attributes
    ----------
    outline_px : ndarray, shape (n, 2)
        Points about a pixel apart.
    corners : tuple of int, optional
        Indices of the tip's left and right corners in the outline; None without corners.
    turn_deg : float
        Change of direction of the outline at the less sharp corner; 0 without corners.
    touches_frame : bool
        Whether the beam reaches the border of the image.
    other_bodies : int
        Number of other dark bodies within the reach of the beam.
    hole_share : float
        Area of the largest bright patch inside the outline, divided by the square of the width.
    """

    outline_px: Array
    corners: tuple[int, int] | None
    turn_deg: float
    touches_frame: bool
    other_bodies: int
    hole_share: float


def measure_back_light(image: NDArray[Any], frame: BeamFrame, width_mm: float) -> BackLight:
    """Fit a quadratic surface to the back-light, and measure the grey value of the beam at its clamp.

    Parameters
    ----------
    image : ndarray, shape (rows, columns)
        Grey values with a dark beam.
    frame : BeamFrame
        Map between millimetres and pixels.
    width_mm : float
        Width of the specimen.

    Returns
    -------
    BackLight
        Grey values of the back-light and of the beam.
    """
    height, width = image.shape
    small_size = (max(1, width // _SHRINK), max(1, height // _SHRINK))
    small = cv2.resize(image, small_size, interpolation=cv2.INTER_AREA).astype(np.float64)
    x = np.linspace(-1.0, 1.0, small_size[0])
    y = np.linspace(-1.0, 1.0, small_size[1])[:, None]
    terms = np.stack(np.broadcast_arrays(np.ones_like(x * y), x, y, x * x, x * y, y * y), axis=-1)
    surface = np.full_like(small, np.percentile(small, 95))
    for share in (0.5, 0.7, 0.8):
        lit = small > share * surface
        if lit.sum() < terms.shape[-1]:
            break
        # Normal equations are accurate enough for six well-scaled terms, and fast for thousands of pixels.
        lit_terms = terms[lit]
        surface = terms @ np.linalg.lstsq(lit_terms.T @ lit_terms, lit_terms.T @ small[lit], rcond=None)[0]
    surface = np.maximum(surface, 0.0)

    root = root_places(frame, width_mm)
    shrink = np.array([small_size[0] / width, small_size[1] / height])
    bright = float(np.median(sample(surface, (root + 0.5) * shrink - 0.5)))
    inside = ((root >= 0.0) & (root <= np.array([width - 1.0, height - 1.0]))).all(axis=1)
    dark = float(np.median(sample(image, root[inside]))) if inside.any() else bright
    return BackLight(surface.astype(np.float32), bright, min(dark, bright))


def root_places(frame: BeamFrame, width_mm: float, aside: float = 0.0) -> Array:
    """Return points (px) spread over the beam, at most one beam width from its clamp.

    Parameters
    ----------
    frame : BeamFrame
        Map between millimetres and pixels.
    width_mm : float
        Width of the specimen.
    aside : float
        Shift of the points across the beam, in beam widths.
    """
    along, across = np.meshgrid(np.linspace(0.3, 0.9, 7), np.linspace(-0.25, 0.25, 5))
    return frame.to_px(width_mm * np.column_stack([along.ravel(), (across + aside).ravel()]))


def find_silhouette(
    image: NDArray[Any],
    frame: BeamFrame,
    clamp: ClampLine,
    light: BackLight,
    shape: StatedShape,
) -> Silhouette | None:
    """Find the outline of the dark body that leaves the clamp.

    Parameters
    ----------
    image : ndarray, shape (rows, columns)
        Grey values with a dark beam.
    frame : BeamFrame
        Map between millimetres and pixels.
    clamp : ClampLine
        Line at which the beam leaves its clamp.
    light : BackLight
        Grey values of the back-light and of the beam.
    shape : StatedShape
        Length and widths of the specimen.

    Returns
    -------
    Silhouette or None
        None if no dark body leaves the clamp, or if its outline is shorter than the beam's length.
    """
    length_mm, width_mm = shape.length_mm, shape.at_clamp_mm
    scale = float(np.linalg.norm(np.diff(frame.to_px([[0.0, 0.0], [1.0, 0.0]]), axis=0)))
    height, width = image.shape
    reach = _REACH * length_mm * scale
    low = np.clip(np.floor(clamp.point_px - reach), 0, [width, height]).astype(int)
    high = np.clip(np.ceil(clamp.point_px + reach), 0, [width, height]).astype(int)
    if (high - low < 3).any():
        return None
    threshold = cv2.resize(0.5 * (light.surface + np.float32(light.dark)), (width, height))
    window = (slice(low[1], high[1]), slice(low[0], high[0]))
    mask = (image[window] < threshold[window]).astype(np.uint8)
    across = np.array([-clamp.ahead[1], clamp.ahead[0]])
    behind = clamp.point_px - low + np.outer([1, -1, -1, 1], 2 * reach * across)
    behind -= np.outer([0, 0, 1, 1], 4 * reach * clamp.ahead)
    cv2.fillConvexPoly(mask, np.rint(behind).astype(np.int32), 0)

    contours, nesting = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    root = tuple(clamp.point_px + 0.3 * width_mm * scale * clamp.ahead - low)
    body, other_bodies, body_index = None, 0, -1
    for index, contour in enumerate(contours):
        if len(contour) < width_mm * scale or nesting[0, index, _PARENT] >= 0:
            continue
        if body is None and cv2.pointPolygonTest(contour, root, False) >= 0:
            body, body_index = contour.reshape(-1, 2) + low, index
        elif cv2.contourArea(contour) > 0.25 * (width_mm * scale) ** 2:
            other_bodies += 1
    if body is None:
        return None
    outline = _from_left_to_right(body.astype(np.float64), frame, clamp)
    if len(outline) < length_mm * scale:
        return None
    at_border = (body <= 0) | (body >= np.array([width - 1, height - 1]))
    corners, turn_deg = _tip_corners(frame.to_mm(outline), shape.at_tip_mm)
    holes = [
        cv2.contourArea(hole) for hole, row in zip(contours, nesting[0], strict=True) if row[_PARENT] == body_index
    ]
    hole_share = max(holes, default=0.0) / (width_mm * scale) ** 2
    return Silhouette(outline, corners, turn_deg, bool(at_border.any()), other_bodies, hole_share)


def _from_left_to_right(contour: Array, frame: BeamFrame, clamp: ClampLine) -> Array:
    """Return the part of a closed contour outside the clamp, from the left to the right edge."""
    free = clamp.distance_px(contour) > 2.5
    if free.all() or not free.any():
        return contour[:0]
    start = int(np.argmin(free))
    contour, free = np.roll(contour, -start, axis=0), np.roll(free, -start)
    border = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]]).astype(np.int8)))
    begin, end = max(zip(border[::2], border[1::2], strict=True), key=lambda run: run[1] - run[0])
    outline = contour[begin:end]
    ends_mm = frame.to_mm(outline[[0, -1]])
    return outline if ends_mm[0, 1] < ends_mm[1, 1] else outline[::-1]


def _tip_corners(outline_mm: Array, width_mm: float) -> tuple[tuple[int, int] | None, float]:
    """Return the indices of the tip's two corners in the outline, and the angle (degrees) of the less sharp one.

    Without corners, the results are None and 0.
    """
    distance = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(outline_mm, axis=0).T))])
    arm = _CORNER_ARM * width_mm
    place = np.arange(0.2 * distance[-1], 0.8 * distance[-1], width_mm / _PLACES_IN_WIDTH)

    def at(where: Array) -> Array:
        return np.column_stack([np.interp(where, distance, axis) for axis in outline_mm.T])

    here = at(place)
    before, after = here - at(place - arm), at(place + arm) - here
    # Around the tip, from the left to the right edge, the outline turns from +x toward +y: the turn is positive.
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    turn = np.degrees(np.arctan2(cross, (before * after).sum(axis=1)))

    highest = scipy.ndimage.maximum_filter1d(turn, _PLACES_IN_WIDTH // 2)
    peaks = np.flatnonzero((turn == highest) & (turn > _LEAST_TURN_DEG))
    best: tuple[int, int] | None = None
    for first in peaks:
        for second in peaks[peaks > first]:
            distance_mm = float(np.linalg.norm(here[second] - here[first]))
            if abs(distance_mm - width_mm) > 0.3 * width_mm:
                continue
            if best is None or turn[first] + turn[second] > turn[best[0]] + turn[best[1]]:
                best = (int(first), int(second))
    if best is None:
        return None, 0.0
    corners = np.searchsorted(distance, place[list(best)])
    return (int(corners[0]), int(corners[1])), float(min(turn[best[0]], turn[best[1]]))
