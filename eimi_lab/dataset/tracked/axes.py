"""Conversion of tracked points from the unit and axes of their file into the beam frame."""

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
    """Information from the user that places tracked points in the beam frame.

    Give either ``calibration``, or ``clamp`` and ``axis_deg`` with the unit.

    Parameters
    ----------
    calibration
        Calibration of the pictures, if the points are in their pixels.
    unit
        Unit of the file: px, mm, cm, m or in; None if the file states it.
    pixels_per_mm
        Scale, if the unit is px.
    clamp
        Middle of the clamp line, in the unit and axes of the file.
    axis_deg
        Direction of the beam at rest, from the file's +x toward its +y.
    sigma
        Standard deviation of a coordinate in the unit of the file; None if the file states it.
    rest
        Number of the frame in which the beam is at rest; None if the file has a reference.
    plane
        For points in three dimensions: the two axes along the picture's x and y, such as ``"xz"``.
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
    """Tracks of n points in k frames, converted into the beam frame; NaN where a point was not seen.

    Parameters
    ----------
    tracks
        The tracks as read from the file.
    places_mm
        (k, n, 2) positions.
    rest_mm
        (n, 2) positions at rest.
    sigma_mm
        (k, n) standard deviations of each coordinate.
    """

    tracks: Tracks
    places_mm: Array
    rest_mm: Array
    sigma_mm: Array


def place(tracks: Tracks, placing: Placing, origin: str) -> PlacedTracks:
    """Convert tracks into the beam frame.

    Parameters
    ----------
    tracks
        The tracks.
    placing
        Information from the user that places the tracks.
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
        rest = to_mm(tracks.rest)
    elif placing.rest is None:
        raise InputError(
            f"{origin}: contains no positions at rest; give --rest FRAME, the frame in which the beam is straight "
            f"(its frames are {tracks.frames[0]} to {tracks.frames[-1]})"
        )
    elif placing.rest not in tracks.frames:
        raise InputError(f"--rest {placing.rest}: {origin} has the frames {tracks.frames[0]} to {tracks.frames[-1]}")
    else:
        rest = places[int(np.flatnonzero(tracks.frames == placing.rest)[0])]
    return PlacedTracks(tracks, places, rest, _sigma_mm(tracks, placing, unit_mm, origin))


def _in_plane(tracks: Tracks, placing: Placing, origin: str) -> Array:
    if tracks.places.shape[-1] == 2:
        if placing.plane is not None:
            raise InputError(f"--plane {placing.plane}: {origin} has points in a plane already")
        return tracks.places
    axes = [("xyz").find(letter) for letter in placing.plane or ""]
    if len(axes) != 2 or -1 in axes or axes[0] == axes[1]:
        fault = f"--plane {placing.plane} is not a plane" if placing.plane else "it has points in three dimensions"
        raise InputError(f"{origin}: {fault}; give the plane in which the beam bends, such as --plane xz")
    return tracks.places[..., axes]


def _to_beam_frame(tracks: Tracks, placing: Placing, origin: str) -> tuple[float, Callable[[Array], Array]]:
    """Return the file's unit in mm, and the function that maps positions (..., 2) of the file to the beam frame."""
    calibration = placing.calibration
    if calibration is not None:
        if not tracks.image_axes or placing.unit not in (None, PIXEL):
            raise InputError(
                f"{origin}: its positions are not pixels of a picture; give --unit, --clamp and --axis in the unit and "
                "axes of the file instead of --calibration"
            )
        if placing.pixels_per_mm is not None:
            raise InputError("--pixels-per-mm: the calibration contains the scale; give one of the two")
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
    """Return the file's unit in mm, as stated by the file or by the user; it is never guessed."""
    if tracks.unit is not None and placing.unit not in (None, tracks.unit):
        raise InputError(f"--unit {placing.unit}: {origin} states that it is in {tracks.unit}")
    unit = tracks.unit or placing.unit
    if unit is None:
        raise InputError(f"{origin}: does not state its unit; give --unit {', '.join(UNITS_MM)} or {PIXEL}")
    if unit != PIXEL:
        if unit not in UNITS_MM:
            raise InputError(f"--unit {unit}: should be one of {', '.join(UNITS_MM)} and {PIXEL}")
        if placing.pixels_per_mm is not None:
            raise InputError(f"--pixels-per-mm: has no meaning for {origin}, which is in {unit}")
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
            f"{origin}: does not state the uncertainty of its positions; give --sigma in its unit, such as 0.1"
        )
    return tracks.sigma * mm_per_unit
