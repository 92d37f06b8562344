"""A dataset of points that another tool tracked, and a table that says which of its frames are which state."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.dataset.csv_tables import Row, read_table
from eimi_lab.dataset.layout import Header
from eimi_lab.dataset.points import NAME_BYTES, TrackedPoints, write_points
from eimi_lab.dataset.state_loads import FRAME_COLUMNS, LOAD_COLUMNS, check_directions, load_of
from eimi_lab.dataset.tracked.axes import PlacedTracks, Placing, place
from eimi_lab.dataset.tracked.formats import FORMATS
from eimi_lab.process.errors import InputError, tell
from eimi_lab.process.outputs import whole_file
from eimi_lab.vision.beam_frame import BeamFrame

MOST_POINTS = 300  # of a dense field: its neighbours' errors are not independent, and a fit takes its time for each
_OFF_THE_BEAM = 0.02  # of its width: a marker stuck on its edge is on it


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
    """Make a dataset of points that a tool of `FORMATS` tracked; returns the number of states. Raises InputError.

    states has a row a state: frame as the tool numbers it, or time_s, and the load. gravity_angle_deg: in the beam
    frame; None where placing has a calibration, which tells it. gravity: whether the weight bends the beam.
    """
    if tool not in FORMATS:
        raise InputError(f"--format {tool}: should be one of {', '.join(FORMATS)}")
    with whole_file(path, force) as temporary:
        placed = place(FORMATS[tool](source), placing, str(source))
        calibration = placing.calibration
        if calibration is not None:
            gravity_angle_deg = BeamFrame(calibration).gravity_deg
            gravity = gravity and calibration.gravity
        if gravity_angle_deg is None and gravity:
            raise InputError(f"{source}: give --gravity-angle, of gravity in the beam frame from +x toward +y")
        rows = read_table(states, [], [*FRAME_COLUMNS, *LOAD_COLUMNS])
        at = [_frame_of(row, placed, source) for row in rows]
        loads = [load_of(row, calibration) for row in rows]
        chosen = _on_the_beam(placed, at, specimen, source)
        tracked = [_points_of(placed, index, chosen, row, source) for index, row in zip(at, rows, strict=True)]
        check_directions(states, loads, gravity_angle_deg)
        write_points(temporary, Header(specimen=specimen), gravity_angle_deg or 0.0, loads, tracked, gravity)
        return len(loads)


def _frame_of(row: Row, placed: PlacedTracks, source: Path) -> int:
    """Where the row's frame is among those of the tracks."""
    tracks = placed.tracks
    if ("frame" in row.cells) == ("time_s" in row.cells):
        raise InputError(f"{row.path}: row 1: needs one of the columns frame and time_s, for frames of {source.name}")
    if "frame" in row.cells:
        found = np.flatnonzero(tracks.frames == row.count("frame"))
        if not len(found):
            raise row.fault("frame", f"one of {source.name}, which has {tracks.frames[0]} to {tracks.frames[-1]}")
        return int(found[0])
    if tracks.times_s is None:
        raise InputError(f"{row.path}: row 1: {source.name} tells no times; give the column frame in place of time_s")
    apart = np.abs(tracks.times_s - row.number("time_s"))
    step = float(np.median(np.diff(tracks.times_s))) if len(tracks.times_s) > 1 else np.inf
    if apart.min() > step:
        raise row.fault("time_s", f"within {source.name}: {tracks.times_s[0]:g} to {tracks.times_s[-1]:g} s")
    return int(apart.argmin())


def _on_the_beam(placed: PlacedTracks, at: list[int], specimen: SpecimenFile, source: Path) -> NDArray[np.int64]:
    """Which points are used: those that lie on the beam at rest and are seen in some state, not too many of them."""
    beam, rest = specimen.specimen, placed.rest_mm
    margin = _OFF_THE_BEAM * beam.width_mm
    along = (rest[:, 0] >= -margin) & (rest[:, 0] <= beam.length_mm + margin)
    on_it = along & (np.abs(rest[:, 1]) <= beam.width_mm / 2 + margin)
    seen = np.isfinite(placed.places_mm[at]).all(axis=-1).any(axis=0)
    chosen = np.flatnonzero(on_it & seen)
    known = np.flatnonzero(np.isfinite(rest).all(axis=1))
    if not len(chosen):
        where = (
            f"the first lies at {rest[known[0], 0]:.4g}, {rest[known[0], 1]:.4g} mm" if len(known) else "none is seen"
        )
        raise InputError(
            f"{source}: of {len(rest)} points none lies on the beam at rest, which reaches from 0, "
            f"{-beam.width_mm / 2:g} to {beam.length_mm:g}, {beam.width_mm / 2:g} mm from its clamp; {where}: check "
            "clamp, axis and unit"
        )
    off = len(rest) - len(chosen)
    if off:
        tell(f"note: {source}: {off} of {len(rest)} points left out: off the beam at rest, or not seen")
    if len(chosen) > MOST_POINTS:
        tell(f"note: {source}: {MOST_POINTS} of {len(chosen)} points taken, evenly in the file's order")
        chosen = chosen[np.linspace(0, len(chosen) - 1, MOST_POINTS).round().astype(int)]
    return chosen


def _points_of(placed: PlacedTracks, index: int, chosen: NDArray[np.int64], row: Row, source: Path) -> TrackedPoints:
    places, sigma = placed.places_mm[index, chosen], placed.sigma_mm[index, chosen]
    seen = np.isfinite(places).all(axis=1) & np.isfinite(sigma)
    if not seen.any():
        raise InputError(f"{row.path}: row {row.line}: {source.name} has no point of the beam in that frame")
    beam_rest = placed.rest_mm[chosen]
    names = tuple(placed.tracks.names[k].encode()[:NAME_BYTES].decode(errors="ignore") for k in chosen[seen])
    return TrackedPoints(names, beam_rest[seen], places[seen], sigma[seen])
