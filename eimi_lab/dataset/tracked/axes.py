"""Convert tracked points from the unit and axes of their file into mm along the straight beam (x) and across it (y)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_lab.config.calibration import Calibration
from eimi_lab.dataset.tracked.tracks import Tracks
from eimi_lab.process.errors import InputError
from eimi_lab.vision.beam_frame import BeamFrame

Array = NDArray[np.float64]

UNITS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
PIXEL = "px"


@dataclass(frozen=True, kw_only=True)
class Placing:
    """Information from the user for the conversion of tracked points into mm along and across the straight beam.

    Either ``calibration``, or ``clamp`` and ``axis_deg`` are given.

    Parameters
    ----------
    calibration
        Calibration of the pictures, if the positions are pixels of these pictures.
    unit
        Unit of the file: px, mm, cm, m or in; None if the file contains its unit.
    pixels_per_mm
        Scale of the pictures, if the unit is px.
    clamp
        Middle of the line at which the beam leaves the clamp, in the unit and axes of the file.
    axis_deg
        Direction in which the beam leaves the clamp, degrees from +x toward +y of the file.
    sigma
        Standard deviation of one coordinate in the unit of the file; None if the file contains it.
    rest
        Number of the frame with the beam at rest; None if the file contains the positions at rest.
    plane
        For points in three dimensions, the two axes of the plane in which the beam bends, such as ``"xz"``.
    """

    calibration: Calibration | None = None
    unit: str | None = None
    pixels_per_mm: float | None = None
    clamp: tuple[float, float] | None = None
    axis_deg: float | None = None
    sigma: float | None = None
    rest: int | None = None
    plane: str | None = None


@dataclass(frozen=True)
class PlacedTracks:
    """Positions of n points in k frames, with x along the straight beam from the clamp, and y across the beam.

    Parameters
    ----------
    tracks
        The tracks in the unit and axes of their file.
    places_mm
        Positions in each frame, mm, shape (k, n, 2); NaN for a point that was not found.
    rest_mm
        Positions at rest, mm, shape (n, 2).
    sigma_mm
        Standard deviation of one coordinate, mm, shape (k, n).
    """

    tracks: Tracks
    places_mm: Array
    rest_mm: Array
    sigma_mm: Array


def place(tracks: Tracks, placing: Placing, origin: str) -> PlacedTracks:
    """Convert tracks (positions of points in frames) into mm along the straight beam from the clamp and across it.

    Parameters
    ----------
    tracks
        The tracks, in the unit and axes of their file.
    placing
        Information from the user about the unit, the axes, the frame without load, and the uncertainty.
    origin
        Name of the file in error messages.

    Raises
    ------
    InputError
        If information is missing or contradicts the file; the message names the option to give.
    """
    flat = _in_plane(tracks, placing, origin)
    unit_mm, to_mm = _to_beam_frame(tracks, placing, origin)
    places = to_mm(flat)
    if tracks.rest is not None:
        if placing.rest is not None:
            raise InputError(
                f"--rest {placing.rest}: {origin} contains the positions at rest, in the reference picture; leave "
                "--rest out"
            )
        rest = to_mm(tracks.rest)
    elif placing.rest is None:
        raise InputError(
            f"{origin}: contains no positions at rest; give --rest FRAME, the frame in which the beam is straight "
            f"(the file has the frames {tracks.frames[0]} to {tracks.frames[-1]})"
        )
    elif placing.rest not in tracks.frames:
        raise InputError(
            f"--rest {placing.rest}: should be a frame of {origin}, which has the frames {tracks.frames[0]} to "
            f"{tracks.frames[-1]}"
        )
    else:
        rest = places[int(np.flatnonzero(tracks.frames == placing.rest)[0])]
    return PlacedTracks(tracks, places, rest, _sigma_mm(tracks, placing, unit_mm, origin))


def _in_plane(tracks: Tracks, placing: Placing, origin: str) -> Array:
    if tracks.places.shape[-1] == 2:
        if placing.plane is not None:
            raise InputError(
                f"--plane {placing.plane}: is for points in three dimensions, but the points of {origin} have two "
                "dimensions; leave --plane out"
            )
        return tracks.places
    axes = [("xyz").find(letter) for letter in placing.plane or ""]
    if len(axes) != 2 or -1 in axes or axes[0] == axes[1]:
        fault = f"--plane {placing.plane} is not a plane" if placing.plane else "has points in three dimensions"
        raise InputError(f"{origin}: {fault}; give the plane in which the beam bends, such as --plane xz")
    return tracks.places[..., axes]


def _to_beam_frame(tracks: Tracks, placing: Placing, origin: str) -> tuple[float, Callable[[Array], Array]]:
    """Return the length of one unit of the file in mm, and a function that converts positions, shape (..., 2).

    The result of the function is in mm along the straight beam from the clamp (x) and across it (y).
    """
    calibration = placing.calibration
    if calibration is not None:
        if not tracks.image_axes or placing.unit not in (None, PIXEL):
            raise InputError(
                f"{origin}: the positions in this file are not pixels of a picture; give --unit, --clamp and --axis in "
                "the unit and axes of the file instead of --calibration"
            )
        if placing.pixels_per_mm is not None:
            raise InputError(
                "--pixels-per-mm: the calibration contains the scale already; give either --pixels-per-mm or "
                "--calibration"
            )
        frame = BeamFrame(calibration)
        return 1.0 / calibration.pixels_per_mm, lambda points: frame.to_mm(points.reshape(-1, 2)).reshape(points.shape)
    unit_mm = _unit_mm(tracks, placing, origin)
    if placing.clamp is None or placing.axis_deg is None:
        raise InputError(
            f"{origin}: give --clamp X,Y and --axis DEG, the point and the direction in which the beam leaves its "
            "clamp, from +x toward +y, in the unit and axes of the file"
            + (", or --calibration of the pictures" if tracks.image_axes else "")
        )
    clamp, axis = np.array(placing.clamp), math.radians(placing.axis_deg)
    axes = np.array([[math.cos(axis), math.sin(axis)], [-math.sin(axis), math.cos(axis)]])
    return unit_mm, lambda points: np.asarray((points - clamp) @ axes.T * unit_mm)


def _unit_mm(tracks: Tracks, placing: Placing, origin: str) -> float:
    """Return the length in mm of one unit of the positions, as the file or the user gives it."""
    if tracks.unit is not None and placing.unit not in (None, tracks.unit):
        raise InputError(f"--unit {placing.unit}: contradicts {origin}, whose unit is {tracks.unit}; leave --unit out")
    unit = tracks.unit or placing.unit
    if unit is None:
        raise InputError(
            f"{origin}: does not contain its unit; give --unit with one of {', '.join(UNITS_MM)} and {PIXEL}"
        )
    if unit != PIXEL:
        if unit not in UNITS_MM:
            raise InputError(f"--unit {unit}: should be one of {', '.join(UNITS_MM)} and {PIXEL}")
        if placing.pixels_per_mm is not None:
            raise InputError(
                f"--pixels-per-mm: is for positions in pixels, but the unit of {origin} is {unit}; leave it out"
            )
        return UNITS_MM[unit]
    if placing.pixels_per_mm is None or not 0 < placing.pixels_per_mm < math.inf:
        more = " or --calibration" if tracks.image_axes else ""
        raise InputError(f"{origin}: is in pixels; give --pixels-per-mm, greater than 0{more}")
    return 1.0 / placing.pixels_per_mm


def _sigma_mm(tracks: Tracks, placing: Placing, mm_per_unit: float, origin: str) -> Array:
    shape = tracks.places.shape[:2]
    if placing.sigma is not None:
        if not 0 < placing.sigma < math.inf:
            raise InputError(f"--sigma {placing.sigma:g}: should be greater than 0, in the unit of {origin}")
        return np.full(shape, placing.sigma * mm_per_unit)
    if tracks.sigma is None:
        raise InputError(
            f"{origin}: does not contain the uncertainty of its positions; give their standard deviation with --sigma, "
            "in the unit of the file, such as 0.1"
        )
    return tracks.sigma * mm_per_unit
