"""Read the text files of the image correlation program DICe, DICe_solution_N.txt.

A file has the results of one frame (first column SUBSET_ID) or of one image region (FRAME), in pixels. Source:
`Schema::write_output` in DICe_Schema.cpp, and files under tests/examples/*/gold, of github.com/dicengine/dice.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eimi_drivers.cameras.image_series import natural_key
from eimi_lab.dataset.tracked.numbers_table import numbers, read_cells, refused
from eimi_lab.dataset.tracked.tracks import Tracks
from eimi_lab.process.errors import InputError

# A file may begin with lines of "***"; the names of the columns and the numbers follow. Coordinates are pixels of the
# reference picture; the centre of the first pixel is 0, 0, and y points down. SIGMA is the standard deviation of a
# displacement, or a negative number if the correlation failed.
_NEEDED = ("COORDINATE_X", "COORDINATE_Y", "DISPLACEMENT_X", "DISPLACEMENT_Y")
_COUNTS = {"SUBSET_ID", "FRAME"}
Columns = dict[str, NDArray[np.float64]]


def read_dice(path: Path) -> Tracks:
    """Return the positions of the subsets in a DICe file, or in all DICe files of a folder, in each frame, px.

    A subset is a small region of the picture. Raises InputError if there is no DICe file, or if DICe did not write it.
    """
    files = sorted(path.glob("*_[0-9]*.txt"), key=lambda file: natural_key(file.name)) if path.is_dir() else [path]
    if not files:
        raise InputError(f"{path}: contains no file of DICe, which has a name such as DICe_solution_0.txt")
    tables = [(file, _read(file)) for file in files]
    of_subsets = ["FRAME" in table for _, table in tables]
    if all(of_subsets):
        return _joined(
            [(f"subset {_number(file)}", frame, row) for file, t in tables for frame, row in _rows(t, "FRAME")]
        )
    if any(of_subsets):
        raise InputError(
            f"{path}: contains files of one frame (with the column SUBSET_ID) and files of one subset (with the column "
            "FRAME); give a folder with files of one kind"
        )
    return _joined(
        [(f"subset {subset}", _number(file), row) for file, t in tables for subset, row in _rows(t, "SUBSET_ID")]
    )


def _read(path: Path) -> Columns:
    (_, header), *body = read_cells(path, ", ", comment="***")
    header = [column for column in header if column]
    if not set(_NEEDED) <= set(header) or not _COUNTS & set(header) or not body:
        raise refused(path, "DICe", f"its columns should be SUBSET_ID or FRAME, {', '.join(_NEEDED)} and others")
    rows = [(line, [cell for cell in row if cell]) for line, row in body]
    if bad := [line for line, row in rows if len(row) != len(header)]:
        raise refused(path, "DICe", f"line {bad[0]} should have {len(header)} numbers, one for each column")
    table = np.array([numbers(path, line, row) for line, row in rows])
    for k, column in enumerate(header):
        if column in _COUNTS and not np.isfinite(table[:, k]).all():
            line = rows[int(np.isfinite(table[:, k]).argmin())][0]
            raise refused(path, "DICe", f"line {line} should have a number in the column {column}")
    return {column: table[:, k] for k, column in enumerate(header)}


def _rows(table: Columns, key: str) -> list[tuple[int, NDArray[np.float64]]]:
    """Return, for each row of a table, the number in the column ``key`` and an array of five numbers in px.

    They are x and y in the reference picture, two displacements, and their standard deviation (NaN if absent).
    """
    sigma = table.get("SIGMA", np.full(len(table[key]), np.nan))
    rows = np.column_stack([*(table[column] for column in _NEEDED), sigma])
    return [(int(number), row) for number, row in zip(table[key], rows, strict=True)]


def _number(file: Path) -> int:
    match = re.search(r"_(\d+)$", file.stem)
    return int(match.group(1)) if match else 0


def _joined(rows: list[tuple[str, int, NDArray[np.float64]]]) -> Tracks:
    names = tuple(dict.fromkeys(name for name, _, _ in rows))
    frames = sorted({frame for _, frame, _ in rows})
    at_name, at_frame = {name: k for k, name in enumerate(names)}, {frame: k for k, frame in enumerate(frames)}
    values = np.full((len(frames), len(names), 5), np.nan)
    for name, frame, row in rows:
        values[at_frame[frame], at_name[name]] = row
    rest, sigma = values[..., :2], values[..., 4]
    places = rest + values[..., 2:4]
    places[sigma < 0.0] = np.nan  # the correlation failed
    has_sigma = np.isfinite(sigma).any()
    return Tracks(
        names=names,
        frames=np.array(frames),
        places=places,
        rest=np.nanmean(rest, axis=0),
        sigma=np.where(sigma > 0.0, sigma, np.nan) if has_sigma else None,
        unit="px",
        image_axes=True,
    )
