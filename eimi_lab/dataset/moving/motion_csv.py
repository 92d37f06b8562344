"""Read motions of the beam from a table with one row for each point of each frame.

The positions are in mm: x along the straight beam from the clamp, and y across the beam.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from eimi_fitting.time.measured import Motion
from eimi_lab.config.csv_tables import Column, Row, read_table
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.dataset.moving.free_motion import free_motions
from eimi_lab.dataset.moving.motion_facts import MotionFacts
from eimi_lab.dataset.tracked.points_csv import COLUMNS as STATE_POINT_COLUMNS
from eimi_lab.dataset.tracked.points_csv import check_on_beam
from eimi_lab.process.errors import InputError

TIME_COLUMNS = {
    "time_s": Column("Time since the beginning of the recording.", "0.35", "frame divided by --rate"),
    "frame": Column(
        "Number of the frame. The column may be left out if all points of a frame have the same time.", "35", "none"
    ),
}
POINT_COLUMNS = {
    name: Column(column.meaning.replace("state", "frame"), column.example, column.default)
    for name, column in STATE_POINT_COLUMNS.items()
    if name != "state"
}


def read_motion_csv(path: Path, specimen: SpecimenFile, facts: MotionFacts) -> tuple[Motion, ...]:
    """Read motions from a table of tracked points.

    Parameters
    ----------
    path : Path
        The table; a missing row means that the point was not found in the frame.
    specimen : SpecimenFile
        The specimen.
    facts : MotionFacts
        Facts about the recording that the user gives. A frame rate converts frame numbers into times.

    Returns
    -------
    tuple of Motion
        One motion for each time that the beam was pushed briefly.

    Raises
    ------
    InputError
        If the table is wrong, or if a point is not on the beam.
    """
    rows = read_table(path, POINT_COLUMNS, TIME_COLUMNS)
    columns = rows[0].cells
    if "frame" not in columns and "time_s" not in columns:
        raise InputError(
            f"{path}: row 1: the columns time_s and frame are missing; add time_s, or add frame and give --rate"
        )
    by_rate = facts.rate_Hz is not None
    if by_rate and "frame" not in columns:
        raise InputError(
            f"{path}: row 1: --rate needs the column frame; a table with the column time_s needs no --rate"
        )
    if not by_rate and "time_s" not in columns:
        raise InputError(f"{path}: row 1: the column time_s is missing; give --rate, the frames per second")

    def frame_of(row: Row) -> float:
        return float(row.count("frame")) if "frame" in columns else row.number("time_s")

    frames = sorted({frame_of(row) for row in rows})
    names = list(dict.fromkeys(row.text("point") for row in rows))
    frame_at, point_at = {value: k for k, value in enumerate(frames)}, {name: k for k, name in enumerate(names)}
    points = np.full((len(frames), len(names), 2), np.nan)
    sigma, time = (np.full(points.shape[:2], np.nan) for _ in range(2))
    rest: dict[int, tuple[float, float]] = {}
    for row in rows:
        k, p = frame_at[frame_of(row)], point_at[row.text("point")]
        if np.isfinite(sigma[k, p]):
            raise InputError(
                f"{path}: row {row.line}: point {row.text('point')} appears twice in one frame; give each point of a "
                "frame one row"
            )
        check_on_beam(row, specimen)
        place = (row.number("x0_mm"), row.number("y0_mm"))
        if rest.setdefault(p, place) != place:
            raise row.fault("x0_mm", f"the same in every frame; {names[p]} was at {rest[p][0]:g}, {rest[p][1]:g} mm")
        points[k, p] = row.number("x_mm"), row.number("y_mm")
        sigma[k, p] = row.number("sigma_mm")
        time[k, p] = frame_of(row) / facts.rate_Hz if facts.rate_Hz else row.number("time_s")
    time = np.where(np.isnan(time), np.nanmin(time, axis=1, keepdims=True), time)
    return free_motions(points, np.array([rest[p] for p in range(len(names))]), time, sigma, facts, str(path))
