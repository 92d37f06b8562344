"""Read the points that the video program DLTdv exports: of one camera in pixels, or in three dimensions.

The y axis points up in versions up to 7, and down in version 8. Source: DLTdv7.m and DLTdv8a_internal/sparseSave.m of
github.com/tlhedrick/dltdv.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eimi_lab.config.toml import read_text
from eimi_lab.dataset.tracked.numbers_table import numbers, read_cells, refused
from eimi_lab.dataset.tracked.tracks import Tracks
from eimi_lab.process.errors import InputError

# PREFIXxypts.csv (or .tsv) contains points of one camera in pixels, PREFIXxyzpts.csv points in three dimensions. A
# dense file has the columns pt1_cam1_X, pt1_cam1_Y, ... and one row for each frame, with NaN for a point that was not
# digitised. A sparse file has a title, the size of the table, and lines with row, column and value. Pixels are counted
# from 1. The file does not contain the version of DLTdv, so the user gives the clamp and the axis in the axes of the
# file.
_NAME = re.compile(r"(pt\d+)(?:_cam(\d+))?_([XYZ])")
_MOST_CELLS = 100_000_000


def read_dltdv(path: Path) -> Tracks:
    """Return the positions of the points in a DLTdv file in each frame (counted from 1), as tracks.

    Raises InputError if DLTdv did not write the file, or if the file has points of several cameras.
    """
    lines = read_text(path).splitlines()
    if len(lines) > 1 and re.fullmatch(r"\d+\t\d+\t\d+", lines[1].strip()):
        columns, table = _sparse(path, lines)
    else:
        (_, header), *body = read_cells(path)
        columns = header
        if bad := [line for line, cells in body if len(cells) != len(header)]:
            raise refused(path, "DLTdv", f"line {bad[0]} should have {len(header)} cells, like the first line")
        table = np.array([numbers(path, line, cells) for line, cells in body]).reshape(len(body), len(header))
    return _tracks(path, columns, table)


def _tracks(path: Path, columns: list[str], table: NDArray[np.float64]) -> Tracks:
    named = [_NAME.fullmatch(column) for column in columns]
    if not named or not all(named) or not len(table):
        raise refused(path, "DLTdv", "its columns should be named pt1_cam1_X, pt1_cam1_Y, … or pt1_X, pt1_Y, pt1_Z, …")
    keys = [match.groups() for match in named if match]
    cameras = {camera for _, camera, _ in keys}
    if len(cameras) > 1:
        raise InputError(
            f"{path}: has points of {len(cameras)} cameras; give a file with the columns of one camera, or the "
            "xyzpts.csv with the points in three dimensions"
        )
    (camera,) = cameras
    axes = ("X", "Y") if camera else ("X", "Y", "Z")
    column_of = {(point, axis): k for k, (point, _, axis) in enumerate(keys)}
    names = tuple(dict.fromkeys(point for point, _, _ in keys))
    if missing := [f"{point}_{axis}" for point in names for axis in axes if (point, axis) not in column_of]:
        raise refused(path, "DLTdv", f"the column {missing[0]} is missing")
    places = np.stack([np.stack([table[:, column_of[name, axis]] for axis in axes], axis=-1) for name in names], axis=1)
    return Tracks(names=names, frames=np.arange(1, len(table) + 1), places=places, unit="px" if camera else None)


def _sparse(path: Path, lines: list[str]) -> tuple[list[str], NDArray[np.float64]]:
    """Convert a DLTdv file that lists only existing values into column names and a table with one row for each frame.

    A value that the file does not list is NaN.
    """
    rows, columns, stored = (int(cell) for cell in lines[1].split("\t"))
    entries = [line.split("\t") for line in lines[2:] if line.strip()]
    if len(entries) != stored or any(len(entry) != 3 for entry in entries) or rows * columns > _MOST_CELLS:
        raise refused(
            path, "DLTdv", f"after line 2 there should be {stored} lines with row, column and value, as line 2 says"
        )
    if columns % 2:
        raise InputError(f"{path}: has {columns} columns; a file of one camera should have two columns for each point")
    table = np.full((rows, columns), np.nan)
    for line, entry in enumerate(entries, 3):
        row, column, value = numbers(path, line, entry)
        if not (1 <= row <= rows and 1 <= column <= columns):
            raise refused(path, "DLTdv", f"line {line} is outside the table of {rows} rows and {columns} columns")
        table[int(row) - 1, int(column) - 1] = value
    return [f"pt{k // 2 + 1}_cam1_{'XY'[k % 2]}" for k in range(columns)], table
