"""From a tool's unit and axes to the beam frame, by what a person says of both."""

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
    """What a person says of tracked points.

    Either calibration, of the pictures in whose pixels they are; or unit (px, mm, cm, m, in), pixels_per_mm for px,
    clamp (middle of the clamp line) and axis_deg (direction of the beam at rest, from the file's +x toward its +y), in
    the file's unit and axes. sigma: standard deviation of a place in the file's unit. rest: the frame in which the beam
    is at rest. plane: for points in three dimensions, which two axes are along the picture's x and y, such as "xz".
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
    """Tracks in the beam frame: places_mm (k, n, 2), rest_mm (n, 2) and sigma_mm (k, n); NaN where not seen."""

    tracks: Tracks
    places_mm: Array
    rest_mm: Array
    sigma_mm: Array


def place(tracks: Tracks, said: Placing, origin: str) -> PlacedTracks:
    """Tracks in the beam frame. Raises InputError that names what has to be said besides; `origin` is the file."""
    flat = _in_plane(tracks, said, origin)
    unit_mm, to_mm = _to_beam_frame(tracks, said, origin)
    places = to_mm(flat)
    if tracks.rest is not None:
        rest = to_mm(tracks.rest)
    elif said.rest is None:
        raise InputError(
            f"{origin}: tells no place at rest; give --rest FRAME, the frame in which the beam hangs straight "
            f"(its frames are {tracks.frames[0]} to {tracks.frames[-1]})"
        )
    elif said.rest not in tracks.frames:
        raise InputError(f"--rest {said.rest}: {origin} has the frames {tracks.frames[0]} to {tracks.frames[-1]}")
    else:
        rest = places[int(np.flatnonzero(tracks.frames == said.rest)[0])]
    return PlacedTracks(tracks, places, rest, _sigma_mm(tracks, said, unit_mm, origin))


def _in_plane(tracks: Tracks, said: Placing, origin: str) -> Array:
    if tracks.places.shape[-1] == 2:
        if said.plane is not None:
            raise InputError(f"--plane {said.plane}: {origin} has points in a plane already")
        return tracks.places
    axes = [("xyz").find(letter) for letter in said.plane or ""]
    if len(axes) != 2 or -1 in axes or axes[0] == axes[1]:
        given = f"--plane {said.plane}" if said.plane else "it has points in three dimensions"
        raise InputError(f"{origin}: {given}; give the plane in which the beam bends, such as --plane xz")
    return tracks.places[..., axes]


def _to_beam_frame(tracks: Tracks, said: Placing, origin: str) -> tuple[float, Callable[[Array], Array]]:
    """Return how many millimetres one of the file's unit is, and what takes places (..., 2) to the beam frame."""
    calibration = said.calibration
    if calibration is not None:
        if not tracks.image_axes or said.unit not in (None, PIXEL):
            raise InputError(
                f"{origin}: its places are not the pixels that a calibration is of; give --unit, --clamp and --axis in "
                "the file's own unit and axes in place of --calibration"
            )
        if said.pixels_per_mm is not None:
            raise InputError("--pixels-per-mm: the calibration tells it; give one of them")
        frame = BeamFrame(calibration)
        return 1.0 / calibration.pixels_per_mm, lambda points: frame.to_mm(points.reshape(-1, 2)).reshape(points.shape)
    unit_mm = _unit_mm(tracks, said, origin)
    if said.clamp is None or said.axis_deg is None:
        raise InputError(
            f"{origin}: give --clamp X,Y and --axis DEG, where the beam leaves its clamp and in which direction, "
            "from +x toward +y, in the unit and axes of the file"
            + (", or --calibration of the pictures" if tracks.image_axes else "")
        )
    clamp, axis = np.array(said.clamp), math.radians(said.axis_deg)
    axes = np.array([[math.cos(axis), math.sin(axis)], [-math.sin(axis), math.cos(axis)]])
    return unit_mm, lambda points: np.asarray((points - clamp) @ axes.T * unit_mm)


def _unit_mm(tracks: Tracks, said: Placing, origin: str) -> float:
    """Millimetres of one of the file's unit: as the file says, or a person; never guessed."""
    if tracks.unit is not None and said.unit not in (None, tracks.unit):
        raise InputError(f"--unit {said.unit}: {origin} says that it is in {tracks.unit}")
    unit = tracks.unit or said.unit
    if unit is None:
        raise InputError(f"{origin}: does not tell its unit; give --unit {', '.join(UNITS_MM)} or {PIXEL}")
    if unit != PIXEL:
        if unit not in UNITS_MM:
            raise InputError(f"--unit {unit}: should be one of {', '.join(UNITS_MM)} and {PIXEL}")
        if said.pixels_per_mm is not None:
            raise InputError(f"--pixels-per-mm: has no meaning for {origin}, which is in {unit}")
        return UNITS_MM[unit]
    if said.pixels_per_mm is None or not 0 < said.pixels_per_mm < math.inf:
        more = " or --calibration" if tracks.image_axes else ""
        raise InputError(f"{origin}: is in pixels; give --pixels-per-mm, greater than 0{more}")
    return 1.0 / said.pixels_per_mm


def _sigma_mm(tracks: Tracks, said: Placing, of_one: float, origin: str) -> Array:
    shape = tracks.places.shape[:2]
    if said.sigma is not None:
        if not 0 < said.sigma < math.inf:
            raise InputError(f"--sigma {said.sigma:g}: should be greater than 0, in the unit of {origin}")
        return np.full(shape, said.sigma * of_one)
    if tracks.sigma is None:
        raise InputError(f"{origin}: does not tell how exact its places are; give --sigma in its unit, such as 0.1")
    return tracks.sigma * of_one
