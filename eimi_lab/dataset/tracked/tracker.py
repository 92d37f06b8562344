"""Read the data file that the video program Tracker (Open Source Physics) exports, with one row for each frame.

Positions are in the unit and axes of Tracker's calibration; the file does not contain the unit. Source:
`ExportDataDialog.java` of github.com/OpenSourcePhysics/tracker.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from eimi_lab.dataset.tracked.numbers_table import numbers, read_cells, refused
from eimi_lab.dataset.tracked.tracks import Tracks

# The file has a row with the names of the tracks ("#multi:" before several names; a single name in early versions), a
# row with the names of the columns, and one row for each frame. The first column is t or frame. A cell is empty if the
# track has no point in the frame. Any separator is possible, and numbers may have decimal commas.
_INDEPENDENT = ("t", "frame", "n", "step")


def read_tracker(path: Path) -> Tracks:
    """Return the positions x and y of each tracked point in each frame of a Tracker file.

    If the first column contains times, the frames are counted from 0. A row without a time or frame number is left out.
    Raises InputError if Tracker did not write the file.
    """
    rows = read_cells(path, "\t;, ")
    at = next((k for k, (_, cells) in enumerate(rows[:3]) if cells[0] in _INDEPENDENT), None)
    if at is None:
        raise refused(path, "Tracker", "a line of columns should begin with t or frame, such as t, x, y")
    header, body = rows[at][1], rows[at + 1 :]
    titles = rows[at - 1][1] if at else []
    names: list[str] = []
    columns: list[tuple[int, int]] = []
    x_at: int | None = None
    title = ""
    for k, column in enumerate(header):
        title = (titles[k] if k < len(titles) else "") or title
        if column == "x":
            x_at = k
        elif column == "y" and x_at is not None:
            names.append(title or (titles[0] if titles else "") or f"track {len(names) + 1}")
            columns.append((x_at, k))
            x_at = None
    if not columns or not body:
        raise refused(path, "Tracker", "there should be columns x and y of each track, and rows below them")
    width = len(header)
    filled = [(line, [*cells, *[""] * (width - len(cells))][:width]) for line, cells in body]
    table = np.array([numbers(path, line, cells) for line, cells in filled])
    numbered = np.flatnonzero(np.isfinite(table[:, 0]))
    if not len(numbered):
        raise refused(path, "Tracker", f"at least one row should have a number in the column {header[0]}")
    table = table[numbered]
    places = np.stack([table[:, list(pair)] for pair in columns], axis=1)
    times = table[:, 0] if header[0] == "t" else None
    frames = numbered if times is not None else table[:, 0].astype(np.int64)
    return Tracks(names=_distinct(names), frames=frames, places=places, times_s=times)


def _distinct(names: list[str]) -> tuple[str, ...]:
    """Return the names of the tracked points, with a number added to names that are not unique."""
    return tuple(
        name if names.count(name) == 1 else f"{name} {names[: k + 1].count(name)}" for k, name in enumerate(names)
    )
