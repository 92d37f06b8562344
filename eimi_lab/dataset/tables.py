"""CSV tables that a person made: every fault is told with file, row, column and value."""

from __future__ import annotations

import csv
import difflib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from eimi_lab.config.reading import read_text
from eimi_lab.errors import InputError


@dataclass(frozen=True)
class Row:
    """One row; `line` is its line in the file, the header's being 1."""

    path: Path
    line: int
    cells: dict[str, str]

    def fault(self, column: str, wanted: str) -> InputError:
        """The error for a cell that is not what it should be."""
        return InputError(f"{self.path}: row {self.line}: {column} = {self.cells[column]!r} should be {wanted}")

    def text(self, column: str) -> str:
        """A cell that is not empty. Raises InputError."""
        if not self.cells[column]:
            raise self.fault(column, "filled in")
        return self.cells[column]

    def number(self, column: str) -> float:
        """A finite number. Raises InputError."""
        try:
            value = float(self.cells[column])
        except ValueError:
            raise self.fault(column, "a number, with a point as decimal sign") from None
        if not math.isfinite(value):
            raise self.fault(column, "a finite number")
        return value

    def count(self, column: str) -> int:
        """A whole number, 0 or more. Raises InputError."""
        if not (self.cells[column].isascii() and self.cells[column].isdigit()):
            raise self.fault(column, "a whole number, 0 or more")
        return int(self.cells[column])


def read_table(path: Path, required: Sequence[str], optional: Sequence[str] = ()) -> list[Row]:
    """The rows below the header; empty lines are passed over. Raises InputError.

    The header may hold the columns in any order. A column that is neither required nor optional is refused: a
    misspelt optional column would else be ignored in silence.
    """
    lines = csv.reader(read_text(path).removeprefix("\ufeff").splitlines())
    try:
        numbered = [(lines.line_num, [cell.strip() for cell in cells]) for cells in lines if any(cells)]
    except csv.Error as error:
        raise InputError(f"{path}: row {lines.line_num}: is not CSV ({error})") from error
    if not numbered:
        raise InputError(f"{path}: is empty; its header should be {','.join(required)}")
    (_, header), *body = numbered
    _check_header(path, header, required, optional)
    rows = []
    for line, cells in body:
        if len(cells) != len(header):
            raise InputError(f"{path}: row {line}: has {len(cells)} cells; the header has {len(header)} columns")
        rows.append(Row(path, line, dict(zip(header, cells, strict=True))))
    if not rows:
        raise InputError(f"{path}: has a header but no rows")
    return rows


def _check_header(path: Path, header: list[str], required: Sequence[str], optional: Sequence[str]) -> None:
    known = [*required, *optional]
    for column in header:
        if header.count(column) > 1:
            raise InputError(f"{path}: row 1: the column {column} appears twice")
        if column not in known:
            near = difflib.get_close_matches(column, known, n=1)
            hint = f"did you mean {near[0]}?" if near else f"known are {', '.join(known)}"
            if ";" in column or "\t" in column:
                hint = "separate the columns by commas"
            raise InputError(f"{path}: row 1: {column!r} is not a known column; {hint}")
    for column in required:
        if column not in header:
            raise InputError(f"{path}: row 1: the column {column} is missing; found {', '.join(header)}")
