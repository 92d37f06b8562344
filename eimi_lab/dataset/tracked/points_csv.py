"""Read points.csv, a table of tracked points with one row for each point of each load step.

Positions are in mm: x along the straight beam from the clamp, and y across the beam.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.strip import Strip
from eimi_lab.config.csv_tables import Column, Row, read_table
from eimi_lab.config.size_along import rows_of
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.dataset.layout import Header
from eimi_lab.dataset.points import NAME_BYTES, TrackedPoints, write_points
from eimi_lab.dataset.state_loads import LOAD_COLUMNS, STATE_COLUMNS, check_directions, numbered_loads
from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import whole_file

COLUMNS = {
    "state": Column("Number of the state, as in states.csv.", "0", "required"),
    "point": Column("Name of the point, the same in every state.", "marker1", "required"),
    "x0_mm": Column("Position along the unloaded beam, measured from the clamp.", "25.0", "required"),
    "y0_mm": Column(
        "Position across the unloaded beam, measured from the centre line. The field of a positive current points in "
        "the positive direction.",
        "0.0",
        "required",
    ),
    "x_mm": Column("Position x in this state, in the beam frame.", "21.73", "required"),
    "y_mm": Column("Position y in this state, in the beam frame.", "9.42", "required"),
    "sigma_mm": Column("Standard uncertainty of x_mm and of y_mm.", "0.02", "required"),
}
DEPTH = "z_mm"
OPTIONAL_COLUMNS = {DEPTH: Column("Position in depth of the unloaded beam, measured from mid-depth.", "2.5", "0")}
ON_THE_BEAM_MM = 1e-6  # tolerance for rounded numbers in a table


def import_points(
    points: Path,
    states: Path,
    specimen: SpecimenFile,
    gravity_angle_deg: float | None,
    path: Path,
    force: bool = False,
    gravity: bool = True,
) -> int:
    """Make a dataset from a table of tracked points and a table of load steps; return the number of load steps.

    Parameters
    ----------
    points, states
        The table of points (points.csv) and the table of load steps (states.csv).
    specimen
        The specimen.
    gravity_angle_deg
        Direction of gravity, degrees from +x (along the straight beam) toward +y (across); None without gravity.
    path
        The dataset to write.
    force
        Whether an existing file is overwritten.
    gravity
        Whether the simulation of the beam includes its weight.

    Raises
    ------
    InputError
        If a table is wrong, or if a point is not on the beam.
    """
    with whole_file(path, force) as temporary:
        loads = numbered_loads(read_table(states, STATE_COLUMNS, LOAD_COLUMNS))
        by_state: dict[int, list[Row]] = {state: [] for state in loads}
        for row in read_table(points, COLUMNS, OPTIONAL_COLUMNS):
            state = row.count("state")
            if state not in by_state:
                raise row.fault("state", f"one of the states in {states}")
            if any(other.text("point") == row.text("point") for other in by_state[state]):
                raise InputError(
                    f"{points}: row {row.line}: point {row.text('point')} appears twice in state {state}; give each "
                    "point of a state one row"
                )
            by_state[state].append(row)
        for state, rows in by_state.items():
            if not rows:
                raise InputError(
                    f"{points}: has no point of state {state}, which {states} lists; add points, or remove the state"
                )
        tracked = [_tracked(rows, specimen) for rows in by_state.values()]
        load_of_state = list(loads.values())
        check_directions(states, load_of_state, gravity_angle_deg)
        write_points(temporary, Header(specimen=specimen), gravity_angle_deg or 0.0, load_of_state, tracked, gravity)
        return len(loads)


def _tracked(rows: list[Row], specimen: SpecimenFile) -> TrackedPoints:
    for row in rows:
        check_on_beam(row, specimen)
        if len(row.text("point").encode()) > NAME_BYTES:
            raise row.fault("point", f"a name of at most {NAME_BYTES} bytes")
    return TrackedPoints(
        tuple(row.text("point") for row in rows),
        np.array([[row.number("x0_mm"), row.number("y0_mm")] for row in rows]),
        np.array([[row.number("x_mm"), row.number("y_mm")] for row in rows]),
        np.array([row.number("sigma_mm") for row in rows]),
        np.array([_depth(row) for row in rows]),
    )


def check_on_beam(row: Row, specimen: SpecimenFile) -> None:
    """Raise InputError if a point in points.csv is not on the beam at rest, or if its uncertainty is not positive."""
    beam = specimen.specimen
    if not -ON_THE_BEAM_MM <= row.number("x0_mm") <= beam.length_mm + ON_THE_BEAM_MM:
        raise row.fault("x0_mm", f"on the beam, from 0 to length_mm = {beam.length_mm:g}")
    strip = Strip(specimen.mechanics())
    along, across = strip.straightened(np.array([[row.number("x0_mm"), row.number("y0_mm")]])).T
    depth = strip.straight_z_mm(along, np.array([_depth(row)]))
    if abs(across[0]) > strip.straight.width_mm / 2 + ON_THE_BEAM_MM:
        raise row.fault("y0_mm", "on the beam, " + _within("width_mm", beam.width_mm, strip.width_mm(along)))
    if abs(depth[0]) > strip.straight.depth_mm / 2 + ON_THE_BEAM_MM:
        raise row.fault(DEPTH, "in the beam, " + _within("depth_mm", beam.depth_mm, strip.depth_mm(along)))
    if row.number("sigma_mm") <= 0:
        raise row.fault("sigma_mm", "greater than 0")


def _within(key: str, size_mm: float, modelled_mm: NDArray[np.float64]) -> str:
    # Return how far a point may be from the centre line of the beam, as a part of an error message. ``size_mm`` is the
    # value of ``key`` ("width_mm" or "depth_mm") in the specimen file. If it varies along the beam, the message
    # contains ``modelled_mm`` (1,), its value at the point.
    if not rows_of(size_mm):
        return f"within half of {key} = {size_mm:g}"
    return f"within half of {key} at this x0_mm = {modelled_mm[0]:.4g} (a step of {key} is a short ramp in the model)"


def _depth(row: Row) -> float:
    return row.number(DEPTH) if row.cells.get(DEPTH) else 0.0
