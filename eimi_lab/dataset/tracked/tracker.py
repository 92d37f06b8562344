"""Tracker's exported data file (Open Source Physics): a row of tracks' names, one of columns, then a row a frame.

Source of the format: `ExportDataDialog.java` of github.com/OpenSourcePhysics/tracker: "#multi:" before several tracks,
the first column t or frame, cells empty where a track has no point, any delimiter, numbers as the locale writes them;
and the first line of earlier versions, a track's name alone. Places are in the unit and axes of Tracker's own
calibration, which the file does not tell.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from eimi_lab.dataset.tracked.numbers_table import numbers, read_cells, refused
from eimi_lab.dataset.tracked.tracks import Tracks

_INDEPENDENT = ("t", "frame", "n", "step")


def read_tracker(path: Path) -> Tracks:
    """The tracks' x and y; other columns are passed over. Frames without a number of their own count from 0.

    Raises InputError.
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
    places = np.stack([table[:, list(pair)] for pair in columns], axis=1)
    times = table[:, 0] if header[0] == "t" else None
    frames = np.arange(len(table)) if times is not None else table[:, 0].astype(np.int64)
    return Tracks(names=_distinct(names), frames=frames, places=places, times_s=times)


def _distinct(names: list[str]) -> tuple[str, ...]:
    """Two tracks of one name get a number each."""
    return tuple(
        name if names.count(name) == 1 else f"{name} {names[: k + 1].count(name)}" for k, name in enumerate(names)
    )
