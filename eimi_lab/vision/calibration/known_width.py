"""Measure the scale and the direction of the beam on an image of the beam at rest, whose width is known."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eimi_lab.config.calibration import Calibration
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edges.dimensions import local_widths
from eimi_lab.vision.edges.edge_set import EdgeSet
from eimi_lab.vision.edges.finding import find_edges
from eimi_lab.vision.edges.profiles import sample
from eimi_lab.vision.edges.stated_shape import StatedShape
from eimi_lab.vision.intensity import eight_bit, grey

Array = NDArray[np.float64]

_ROUNDS = 3
_CLEAR_OF_CLAMP_PX = 8.0
# These flags make the outline useless as a scale; a wrong length or a poor focus does not.
_FATAL = ("SATURATED", "GAMMA", "TOUCHES_FRAME", "MULTI_CONTOUR", "CORNER_AMBIGUOUS", "CLAMP_NOT_FOUND")


@dataclass(frozen=True)
class BeamPose:
    """Scale and place of the beam at rest in an image.

    Attributes
    ----------
    pixels_per_mm : float
        Scale of the image.
    pixels_per_mm_sigma : float
        Standard deviation of the scale due to noise; without the uncertainty of the specimen's width.
    clamp_midpoint_px : tuple of float
        Middle of the line at which the beam leaves its clamp.
    axis_angle_deg : float
        Direction of the beam, clockwise from +x of the image.
    axis_angle_sigma_deg : float
        Standard deviation of this direction.
    """

    pixels_per_mm: float
    pixels_per_mm_sigma: float
    clamp_midpoint_px: tuple[float, float]
    axis_angle_deg: float
    axis_angle_sigma_deg: float


def measure_beam(image: NDArray[Any], specimen: SpecimenFile, guess: Calibration) -> BeamPose:
    """Measure scale, clamp and axis on one image of the beam at rest.

    Parameters
    ----------
    image : ndarray, shape (rows, columns) or (rows, columns, 3)
        The beam in front of a back-light.
    specimen : SpecimenFile
        The specimen, whose width gives the scale.
    guess : Calibration
        `clamp_midpoint_px` must be right to a third of a beam's width, `axis_angle_deg` to a few degrees.

    Returns
    -------
    BeamPose
        Scale, clamp and axis.

    Raises
    ------
    ValueError
        If the image shows no beam, or if the beam or the clamp's edge cannot be measured.
    """
    pixels = grey(image)
    shape = StatedShape(specimen.mechanics())
    scale = _rough_width_px(pixels, guess) / shape.median_mm
    calibration = guess.model_copy(update={"pixels_per_mm": scale})
    for _ in range(_ROUNDS):
        edges = _edges_of(pixels, specimen, calibration)
        left, right = edges.left.points_mm, edges.right.points_mm
        frame = BeamFrame(calibration)
        midpoint = _clamp_midpoint(edges, frame)
        widths = shape.even_widths(left, local_widths(left, right), frame.to_mm(edges.corners_px[:2]))
        tilt, tilt_sigma = _tilt(left, right)
        stretch = float(np.median(widths)) / specimen.specimen.width_mm
        calibration = calibration.model_copy(
            update={
                "pixels_per_mm": calibration.pixels_per_mm * stretch,
                "clamp_midpoint_px": midpoint,
                "axis_angle_deg": calibration.axis_angle_deg + frame.hand * math.degrees(tilt),
            }
        )
    spread = float(widths.std(ddof=1) / widths.mean())
    return BeamPose(
        pixels_per_mm=calibration.pixels_per_mm,
        pixels_per_mm_sigma=calibration.pixels_per_mm * spread / math.sqrt(len(widths)),
        clamp_midpoint_px=calibration.clamp_midpoint_px,
        axis_angle_deg=calibration.axis_angle_deg,
        axis_angle_sigma_deg=math.degrees(tilt_sigma),
    )


def measure_clamp(image: NDArray[Any], specimen: SpecimenFile, calibration: Calibration) -> tuple[float, float]:
    """Return the middle of the clamp's edge (px), measured on one image.

    Parameters
    ----------
    image : ndarray, shape (rows, columns) or (rows, columns, 3)
        The beam in front of a back-light.
    specimen : SpecimenFile
        The specimen in the image.
    calibration : Calibration
        Its scale and axis must be right. Its `clamp_midpoint_px` may be wrong by a third of the beam's width.

    Raises
    ------
    ValueError
        If the beam or the clamp's edge cannot be measured.
    """
    for _ in range(_ROUNDS):
        midpoint = _clamp_midpoint(_edges_of(grey(image), specimen, calibration), BeamFrame(calibration))
        calibration = calibration.model_copy(update={"clamp_midpoint_px": midpoint})
    return calibration.clamp_midpoint_px


def _edges_of(pixels: NDArray[Any], specimen: SpecimenFile, calibration: Calibration) -> EdgeSet:
    """Return the edges of the beam; raise ValueError if they are missing or not accurate enough."""
    edges = find_edges(pixels, calibration, specimen)
    fatal_flags = [flag for flag in edges.flags if flag.name in _FATAL]
    if fatal_flags or not len(edges.left.points_mm):
        reason = (fatal_flags or list(edges.flags))[0]
        raise ValueError(f"the beam cannot be measured: {reason.name}; {reason.remedy}")
    return edges


def _clamp_midpoint(edges: EdgeSet, frame: BeamFrame) -> tuple[float, float]:
    """Return the middle of the beam at its clamp, px; raise ValueError if the clamp's edge is not visible."""
    if not np.isfinite(edges.corners_px[:2]).all():
        raise ValueError("the edge of the clamp is not visible; take the picture in front of a back-light")
    x, y = frame.to_px(frame.to_mm(edges.corners_px[:2]).mean(axis=0))[0]
    return float(x), float(y)


def _tilt(left: Array, right: Array) -> tuple[float, float]:
    """Return the angle (rad) of the first half of the beam in the beam frame, and its standard deviation.

    `left`, `right`: points of both edges, ordered from the clamp, mm.
    """
    angles, variances = [], []
    for points in (left, right):
        near = points[: max(4, len(points) // 2)]
        (slope, _), covariance = np.polyfit(near[:, 0], near[:, 1], 1, cov=True)
        angles.append(math.atan(slope))
        variances.append(float(covariance[0, 0]))
    return float(np.mean(angles)), 0.5 * math.sqrt(sum(variances))


def _rough_width_px(pixels: NDArray[Any], guess: Calibration) -> float:
    """Return the median width of the beam (px), accurate to one or two pixels."""
    grey_values = eight_bit(pixels)
    _, bright = cv2.threshold(grey_values, 0, 1, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    angle = math.radians(guess.axis_angle_deg)
    along, across = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
    height, width = grey_values.shape
    root = np.array(guess.clamp_midpoint_px) + _CLEAR_OF_CLAMP_PX * along
    if sample(bright, root) > 0.5:  # a lit beam, or no beam; without a beam the runs do not end
        bright = 1 - bright
    runs = []
    for ahead in np.arange(0.0, max(height, width), 4.0):
        centre = root + ahead * along
        run = [_dark_steps(bright, centre, sign * across) for sign in (-1.0, 1.0)]
        if None in run:
            break
        runs.append(float(sum(step for step in run if step is not None)))
    if len(runs) < 5:
        raise ValueError("no beam leaves clamp_midpoint_px in the direction axis_angle_deg; correct the two values")
    return float(np.median(runs))


def _dark_steps(bright: NDArray[Any], begin: Array, direction: Array) -> int | None:
    """Return the number of dark pixels from a point to the first bright pixel along a direction, or None.

    None if the point is bright, or if no pixel in this direction is bright.
    """
    steps = np.arange(max(bright.shape))
    places = np.rint(begin + steps[:, None] * direction).astype(int)
    inside = ((places >= 0) & (places < [bright.shape[1], bright.shape[0]])).all(axis=1)
    places = places[inside]
    lit = np.flatnonzero(bright[places[:, 1], places[:, 0]])
    return int(lit[0]) if len(lit) and lit[0] > 0 else None
