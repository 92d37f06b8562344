"""Make a dataset from points that another program tracked, and from a table with the frame of each load step."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.strip import Strip
from eimi_lab.config.csv_tables import Row, read_table
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.dataset.layout import Header
from eimi_lab.dataset.points import NAME_BYTES, TrackedPoints, write_points
from eimi_lab.dataset.state_loads import FRAME_COLUMNS, LOAD_COLUMNS, check_directions, load_of
from eimi_lab.dataset.tracked.axes import PlacedTracks, Placing, place
from eimi_lab.dataset.tracked.formats import reader_of
from eimi_lab.process.errors import InputError, tell
from eimi_lab.process.outputs import whole_file
from eimi_lab.vision.beam_frame import BeamFrame

MOST_POINTS = 300  # largest number of points: errors of near points are correlated, and each point costs time in a fit
_OFF_THE_BEAM = 0.02  # tolerance relative to the beam's width: a marker on the edge counts as on the beam
_AT_ONCE = 10_000  # number of points whose nearest points of the beam are computed at once


def import_tracks(
    source: Path,
    tool: str,
    states: Path,
    specimen: SpecimenFile,
    placing: Placing,
    gravity_angle_deg: float | None,
    path: Path,
    force: bool = False,
    gravity: bool = True,
) -> int:
    """Make a dataset from points that another program tracked, and return the number of load steps.

    Parameters
    ----------
    source
        The file or the folder that the tracking program wrote.
    tool
        Name of the tracking program on the command line, such as "tracker".
    states
        Table with the frame (number or time) and the loads of each load step.
    specimen
        The specimen.
    placing
        How coordinates are converted into mm along and across the straight beam.
    gravity_angle_deg
        Direction of gravity, degrees from +x (the straight beam) toward +y. Not used if `placing` has a calibration.
    path
        The dataset to write.
    force
        Whether an existing file is overwritten.
    gravity
        Whether the simulation of the beam includes its weight.

    Raises
    ------
    InputError
        If a file is wrong, if information is missing, or if no point is on the beam.
    """
    read = reader_of(tool)
    with whole_file(path, force) as temporary:
        placed = place(read(source), placing, str(source))
        calibration = placing.calibration
        if calibration is not None:
            gravity_angle_deg = BeamFrame(calibration).gravity_deg
            gravity = gravity and calibration.gravity
        if gravity_angle_deg is None and gravity:
            raise InputError(
                f"{source}: give --gravity-angle, the direction of gravity in the beam frame, in degrees from +x "
                "(along the straight beam from the clamp) toward +y (across the beam)"
            )
        rows = read_table(states, [], [*FRAME_COLUMNS, *LOAD_COLUMNS])
        at = [_frame_of(row, placed, source) for row in rows]
        loads = [load_of(row, calibration) for row in rows]
        chosen = points_on_beam(placed, at, specimen, source)
        tracked = [_points_of(placed, index, chosen, row, source) for index, row in zip(at, rows, strict=True)]
        check_directions(states, loads, gravity_angle_deg)
        write_points(temporary, Header(specimen=specimen), gravity_angle_deg or 0.0, loads, tracked, gravity)
        return len(loads)


def _frame_of(row: Row, placed: PlacedTracks, source: Path) -> int:
    """Return the index of the tracked frame whose number or time is in a row of the table of load steps.

    Raises InputError if there is no such frame.
    """
    tracks = placed.tracks
    if ("frame" in row.cells) == ("time_s" in row.cells):
        raise InputError(
            f"{row.path}: row 1: needs one of the columns frame and time_s, which specify frames of {source.name}"
        )
    if "frame" in row.cells:
        indices = np.flatnonzero(tracks.frames == row.count("frame"))
        if not len(indices):
            raise row.fault(
                "frame", f"a frame of {source.name}, which has the frames {tracks.frames[0]} to {tracks.frames[-1]}"
            )
        return int(indices[0])
    if tracks.times_s is None:
        raise InputError(f"{row.path}: row 1: {source.name} has no times; give the column frame instead of time_s")
    apart = np.abs(tracks.times_s - row.number("time_s"))
    step = float(np.median(np.diff(tracks.times_s))) if len(tracks.times_s) > 1 else np.inf
    if apart.min() > step:
        raise row.fault("time_s", f"a time of {source.name}, from {tracks.times_s[0]:g} to {tracks.times_s[-1]:g} s")
    return int(apart.argmin())


def points_on_beam(
    placed: PlacedTracks, at: list[int], specimen: SpecimenFile, source: Path, margin_mm: float | None = None
) -> NDArray[np.int64]:
    """Return the indices of the n tracked points that are on the beam at rest and appear in a used frame, shape (n,).

    ``at`` contains the indices of the used frames. ``margin_mm`` is the allowed distance from the beam (by default 2 %
    of its width). Of very many points, only some are returned. Raises InputError if there is no suitable point.
    """
    beam, rest = specimen.specimen, placed.rest_mm
    margin = _OFF_THE_BEAM * beam.width_mm if margin_mm is None else margin_mm
    strip = Strip(specimen.mechanics())
    parts = np.array_split(rest, len(rest) // _AT_ONCE + 1)
    off_mm = np.concatenate([np.abs(part - strip.nearest(part)).max(axis=1) for part in parts])
    on_it = off_mm <= margin
    is_seen = np.isfinite(placed.places_mm[at]).all(axis=-1).any(axis=0)
    chosen = np.flatnonzero(on_it & is_seen)
    with_rest = np.flatnonzero(np.isfinite(rest).all(axis=1))
    if not len(chosen):
        where = "no point was seen at rest"
        if len(with_rest):
            x, y = rest[with_rest[0]]
            where = f"the first point is at x = {x:.4g}, y = {y:.4g} mm"
        shape = "" if strip.is_straight else ", before it takes its rest_shape or its tables of widths"
        raise InputError(
            f"{source}: none of the points ({len(rest)}) is on the beam at rest, which reaches from x = 0 to "
            f"{beam.length_mm:g} mm and from y = {-beam.width_mm / 2:g} to {beam.width_mm / 2:g} mm{shape}; {where}; "
            "check --clamp, --axis and --unit, or the calibration"
        )
    off = len(rest) - len(chosen)
    if off:
        tell(
            f"note: {source}: {off} of {len(rest)} points were left out, because they are not on the beam at rest or "
            "were not seen"
        )
    if len(chosen) > MOST_POINTS:
        tell(
            f"note: {source}: only {MOST_POINTS} of {len(chosen)} points are used; they are evenly spaced in the "
            "order of the file"
        )
        chosen = chosen[np.linspace(0, len(chosen) - 1, MOST_POINTS).round().astype(int)]
    return chosen


def _points_of(placed: PlacedTracks, index: int, chosen: NDArray[np.int64], row: Row, source: Path) -> TrackedPoints:
    places, sigma = placed.places_mm[index, chosen], placed.sigma_mm[index, chosen]
    is_seen = np.isfinite(places).all(axis=1) & np.isfinite(sigma)
    if not is_seen.any():
        raise InputError(
            f"{row.path}: row {row.line}: {source.name} has no point of the beam in this frame; list another frame"
        )
    beam_rest = placed.rest_mm[chosen]
    names = tuple(placed.tracks.names[k].encode()[:NAME_BYTES].decode(errors="ignore") for k in chosen[is_seen])
    return TrackedPoints(names, beam_rest[is_seen], places[is_seen], sigma[is_seen])
