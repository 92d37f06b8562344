"""Scale and orientation without a board: from the beam itself, hanging at rest, whose width somebody measured."""

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
from eimi_lab.vision.intensity import eight_bit, grey

Array = NDArray[np.float64]

_ROUNDS = 3
_CLEAR_OF_CLAMP_PX = 8.0
# What makes the outline useless as a ruler; a wrong length or focus does not.
_FATAL = ("SATURATED", "GAMMA", "TOUCHES_FRAME", "MULTI_CONTOUR", "CORNER_AMBIGUOUS", "CLAMP_NOT_FOUND")


@dataclass(frozen=True)
class BeamPose:
    """How the beam at rest lies in the image and how large a millimetre is; the deviations are those of its points."""

    pixels_per_mm: float
    pixels_per_mm_sigma: float
    clamp_midpoint_px: tuple[float, float]
    axis_angle_deg: float
    axis_angle_sigma_deg: float


def measure_beam(image: NDArray[Any], specimen: SpecimenFile, guess: Calibration) -> BeamPose:
    """Scale, clamp and axis from one image of the beam at rest. Raises ValueError where it shows none, or badly.

    guess: clamp_midpoint_px to a third of a beam's width and axis_angle_deg to a few degrees; its scale is not used.
    """
    pixels = grey(image)
    scale = _rough_width_px(pixels, guess) / specimen.specimen.width_mm
    calibration = guess.model_copy(update={"pixels_per_mm": scale})
    for _ in range(_ROUNDS):
        edges = _edges_of(pixels, specimen, calibration)
        left, right = edges.left.points_mm, edges.right.points_mm
        widths = local_widths(left, right)
        frame = BeamFrame(calibration)
        tilt, tilt_sigma = _tilt(left, right)
        stretch = float(np.median(widths)) / specimen.specimen.width_mm
        calibration = calibration.model_copy(
            update={
                "pixels_per_mm": calibration.pixels_per_mm * stretch,
                "clamp_midpoint_px": _clamp_midpoint(edges, frame),
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
    """The middle of the clamp line, px, from one image of the beam. Raises ValueError where it shows none, or badly.

    calibration: its scale and axis hold; clamp_midpoint_px need be right to a third of a beam's width only.
    """
    for _ in range(_ROUNDS):
        midpoint = _clamp_midpoint(_edges_of(grey(image), specimen, calibration), BeamFrame(calibration))
        calibration = calibration.model_copy(update={"clamp_midpoint_px": midpoint})
    return calibration.clamp_midpoint_px


def _edges_of(pixels: NDArray[Any], specimen: SpecimenFile, calibration: Calibration) -> EdgeSet:
    """Edges that will do as a ruler. Raises ValueError where there are none."""
    edges = find_edges(pixels, calibration, specimen)
    wrong = [flag for flag in edges.flags if flag.name in _FATAL]
    if wrong or not len(edges.left.points_mm):
        told = (wrong or list(edges.flags))[0]
        raise ValueError(f"the beam cannot be measured: {told.name}; {told.remedy}")
    return edges


def _clamp_midpoint(edges: EdgeSet, frame: BeamFrame) -> tuple[float, float]:
    if not np.isfinite(edges.corners_px[:2]).all():
        raise ValueError("the line of the clamp is not seen; take the picture in front of a back-light")
    x, y = frame.to_px(frame.to_mm(edges.corners_px[:2]).mean(axis=0))[0]
    return float(x), float(y)


def _tilt(left: Array, right: Array) -> tuple[float, float]:
    """Angle of the beam's first half against the x axis, rad from +x toward +y, and its standard deviation."""
    angles, variances = [], []
    for points in (left, right):
        near = points[: max(4, len(points) // 2)]
        (slope, _), covariance = np.polyfit(near[:, 0], near[:, 1], 1, cov=True)
        angles.append(math.atan(slope))
        variances.append(float(covariance[0, 0]))
    return float(np.mean(angles)), 0.5 * math.sqrt(sum(variances))


def _rough_width_px(pixels: NDArray[Any], guess: Calibration) -> float:
    """Width of the body across the axis ahead of the clamp, to a pixel or two."""
    shown = eight_bit(pixels)
    _, bright = cv2.threshold(shown, 0, 1, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    angle = math.radians(guess.axis_angle_deg)
    along, across = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
    height, width = shown.shape
    root = np.array(guess.clamp_midpoint_px) + _CLEAR_OF_CLAMP_PX * along
    if sample(bright, root) > 0.5:  # a lit beam; or none, and then the runs do not end
        bright = 1 - bright
    runs = []
    for ahead in np.arange(0.0, max(height, width), 4.0):
        centre = root + ahead * along
        run = [_dark_steps(bright, centre, sign * across) for sign in (-1.0, 1.0)]
        if None in run:
            break
        runs.append(float(sum(step for step in run if step is not None)))
    if len(runs) < 5:
        raise ValueError("no beam leaves clamp_midpoint_px along axis_angle_deg")
    return float(np.median(runs))


def _dark_steps(bright: NDArray[Any], begin: Array, direction: Array) -> int | None:
    """Pixels from a place to the first bright one; None where the place itself is bright or the image ends first."""
    steps = np.arange(max(bright.shape))
    places = np.rint(begin + steps[:, None] * direction).astype(int)
    inside = ((places >= 0) & (places < [bright.shape[1], bright.shape[0]])).all(axis=1)
    places = places[inside]
    lit = np.flatnonzero(bright[places[:, 1], places[:, 0]])
    return int(lit[0]) if len(lit) and lit[0] > 0 else None
