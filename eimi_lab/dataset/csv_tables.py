"""CSV tables that a person made: every fault is told with file, row, column and value."""

from __future__ import annotations

import csv
import difflib
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from eimi_lab.config.toml import read_text
from eimi_lab.process.errors import InputError


@dataclass(frozen=True)
class Column:
    """A column of a table, for people: what is in it, a cell, and what an absent or empty one stands for."""

    meaning: str
    example: str
    default: str = ""


@dataclass(frozen=True)
class Row:
    """One row; `line` is its line in the file, the header's being 1.

    decimal_comma: whether a number may have one, for the cells are not separated by commas.
    """

    path: Path
    line: int
    cells: dict[str, str]
    decimal_comma: bool = False

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
        cell = self.cells[column]
        if self.decimal_comma and cell.count(",") == 1 and "." not in cell:
            cell = cell.replace(",", ".")
        try:
            value = float(cell)
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


def read_table(path: Path, required: Iterable[str], optional: Iterable[str] = ()) -> list[Row]:
    """The rows below the header; empty lines are passed over. Raises InputError.

    The header may hold the columns in any order. A column that is neither required nor optional is refused: a
    misspelt optional column would else be ignored in silence. Cells are separated by commas; or by semicolons or tabs,
    as a spreadsheet does where numbers have a decimal comma, which is then read as well.
    """
    text = read_text(path).removeprefix("\ufeff").splitlines()
    separator = _separator(next((line for line in text if line.strip()), ""))
    lines = csv.reader(text, delimiter=separator)
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
            commas = "; numbers with a decimal comma want semicolons between the cells" if separator == "," else ""
            told = f"has {len(cells)} cells; the header has {len(header)} columns"
            raise InputError(f"{path}: row {line}: {told}{commas if len(cells) > len(header) else ''}")
        rows.append(Row(path, line, dict(zip(header, cells, strict=True)), decimal_comma=separator != ","))
    if not rows:
        raise InputError(f"{path}: has a header but no rows")
    return rows


def _separator(header: str) -> str:
    """What separates the columns' names, of which none has any of these signs in it."""
    return max(",;\t", key=header.count)


def _check_header(path: Path, header: list[str], required: Iterable[str], optional: Iterable[str]) -> None:
    known = [*required, *optional]
    for column in header:
        if header.count(column) > 1:
            raise InputError(f"{path}: row 1: the column {column} appears twice")
        if column not in known:
            near = difflib.get_close_matches(column, known, n=1)
            hint = f"did you mean {near[0]}?" if near else f"known are {', '.join(known)}"
            raise InputError(f"{path}: row 1: {column!r} is not a known column; {hint}")
    if missing := [column for column in required if column not in header]:
        words = f"column {missing[0]} is" if len(missing) == 1 else f"columns {', '.join(missing)} are"
        raise InputError(f"{path}: row 1: the {words} missing; found {', '.join(header)}")
