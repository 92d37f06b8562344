"""Read the CSV file that DeepLabCut writes for a video, with x, y (px from the upper left corner) and likelihood.

Source: DeepLabCut, `deeplabcut/pose_estimation_tensorflow/predict_videos.py`, and "Standard DeepLabCut user guide".
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from eimi_lab.dataset.tracked.numbers_table import numbers, read_cells, refused
from eimi_lab.dataset.tracked.tracks import Tracks

LEAST_LIKELIHOOD = 0.6  # DeepLabCut's default `pcutoff`: a position with a smaller likelihood counts as not seen
# The header rows are scorer, individuals (for several animals), bodyparts and coords; one row for each frame follows.
_HEADER = ("scorer", "individuals", "bodyparts", "coords")


def read_deeplabcut(path: Path) -> Tracks:
    """Read a DeepLabCut file, and return the position of each tracked point in each frame, px.

    A position with a low likelihood counts as not found. Raises InputError if DeepLabCut did not write the file.
    """
    rows = read_cells(path, ",")
    header = {cells[0]: cells[1:] for _, cells in rows[:4] if cells[0] in _HEADER}
    body = [(line, cells) for line, cells in rows if cells[0] not in _HEADER]
    if not {"bodyparts", "coords"} <= header.keys() or not body:
        raise refused(path, "DeepLabCut", "the first rows should begin with scorer, bodyparts and coords")
    parts, coords = header["bodyparts"], header["coords"]
    for name in ("individuals", "bodyparts"):
        if name in header and len(header[name]) != len(coords):
            raise refused(
                path,
                "DeepLabCut",
                f"the rows {name} and coords should have equal numbers of cells, not {len(header[name])} and "
                f"{len(coords)}",
            )
    if animals := header.get("individuals"):
        parts = [
            part if animal == "single" else f"{animal} {part}" for animal, part in zip(animals, parts, strict=True)
        ]
    width = len(coords) + 1
    if bad := [line for line, cells in body if len(cells) != width or not cells[0].isdecimal()]:
        raise refused(
            path, "DeepLabCut", f"line {bad[0]} should have the number of a frame and {width - 1} further cells"
        )
    table = np.array([numbers(path, line, cells[1:]) for line, cells in body])
    columns = {(part, coord): table[:, k] for k, (part, coord) in enumerate(zip(parts, coords, strict=True))}
    names = tuple(part for part in dict.fromkeys(parts) if (part, "x") in columns and (part, "y") in columns)
    if not names:
        raise refused(path, "DeepLabCut", "the row coords should contain x and y for a part of bodyparts")
    places = np.stack([np.stack([columns[name, "x"], columns[name, "y"]], axis=-1) for name in names], axis=1)
    for k, name in enumerate(names):
        if (name, "likelihood") in columns:
            places[~(columns[name, "likelihood"] >= LEAST_LIKELIHOOD), k] = np.nan
    frames = np.array([int(cells[0]) for _, cells in body])
    return Tracks(names=names, frames=frames, places=places, unit="px", image_axes=True)
