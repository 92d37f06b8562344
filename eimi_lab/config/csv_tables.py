"""Read CSV tables that a user writes."""

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
    """A column of a CSV table, for the documentation.

    Parameters
    ----------
    meaning
        What the values are.
    example
        Example of a cell.
    default
        What an empty cell or an absent column means; an empty text if the column is required.
    """

    meaning: str
    example: str
    default: str = ""


@dataclass(frozen=True)
class Row:
    """One row of a CSV table.

    Parameters
    ----------
    path
        The file.
    line
        Number of the line in the file; the header is line 1.
    cells
        Text of each cell, by name of the column.
    decimal_comma
        Whether numbers may have a decimal comma.
    """

    path: Path
    line: int
    cells: dict[str, str]
    decimal_comma: bool = False

    def fault(self, column: str, wanted: str) -> InputError:
        """Return the error for a cell with a wrong value.

        ``wanted`` describes the right value in the message, such as "a finite number".
        """
        return InputError(f"{self.path}: row {self.line}: {column} = {self.cells[column]!r} should be {wanted}")

    def text(self, column: str) -> str:
        """Return the text of a cell. Raises InputError if the cell is empty."""
        if not self.cells[column]:
            raise self.fault(column, "filled in, because the column is required")
        return self.cells[column]

    def number(self, column: str) -> float:
        """Return the number in a cell. Raises InputError if the cell does not contain a finite number."""
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
        """Return the integer in a cell. Raises InputError if the cell is not an integer of 0 or more."""
        if not (self.cells[column].isascii() and self.cells[column].isdigit()):
            raise self.fault(column, "a whole number, 0 or more")
        return int(self.cells[column])


def read_table(path: Path, required: Iterable[str], optional: Iterable[str] = ()) -> list[Row]:
    """Return the rows of a CSV table that has a header.

    Cells are separated by commas, semicolons or tabs.

    Parameters
    ----------
    path
        The file.
    required, optional
        Names of the columns, in any order. Other columns are an error.

    Raises
    ------
    InputError
        If the file cannot be read, or if the header or a row is wrong.
    """
    numbered, separator = read_cells(path)
    if not numbered:
        raise InputError(f"{path}: is empty; its header should be {','.join(required)}")
    (_, header), *body = numbered
    _check_header(path, header, required, optional)
    rows = []
    for line, cells in body:
        if len(cells) != len(header):
            commas = "; numbers with a decimal comma need semicolons between the cells" if separator == "," else ""
            fault = f"has {len(cells)} cells, but the header has {len(header)} columns"
            raise InputError(f"{path}: row {line}: {fault}{commas if len(cells) > len(header) else ''}")
        rows.append(Row(path, line, dict(zip(header, cells, strict=True)), decimal_comma=separator != ","))
    if not rows:
        raise InputError(f"{path}: has a header but no rows; add rows below the header")
    return rows


def read_cells(path: Path) -> tuple[list[tuple[int, list[str]]], str]:
    """Return the rows of a CSV table that are not empty, each with the number of its line, and the separator of cells.

    The separator is the most frequent of comma, semicolon and tab in the header. If it is not a comma, numbers may have
    a decimal comma.

    Raises
    ------
    InputError
        If the file cannot be read, or if it is not CSV.
    """
    text = read_text(path).removeprefix("\ufeff").splitlines()
    separator = max(",;\t", key=next((line for line in text if line.strip()), "").count)
    lines = csv.reader(text, delimiter=separator)
    try:
        return [(lines.line_num, [cell.strip() for cell in cells]) for cells in lines if any(cells)], separator
    except csv.Error as error:
        raise InputError(f"{path}: row {lines.line_num}: is not CSV ({error})") from error


def _check_header(path: Path, header: list[str], required: Iterable[str], optional: Iterable[str]) -> None:
    columns = [*required, *optional]
    for column in header:
        if header.count(column) > 1:
            raise InputError(f"{path}: row 1: the column {column} appears twice")
        if column not in columns:
            near = difflib.get_close_matches(column, columns, n=1)
            hint = f"did you mean {near[0]}?" if near else f"the known columns are {', '.join(columns)}"
            raise InputError(f"{path}: row 1: {column!r} is not a known column; {hint}")
    if missing := [column for column in required if column not in header]:
        words = f"column {missing[0]} is" if len(missing) == 1 else f"columns {', '.join(missing)} are"
        raise InputError(f"{path}: row 1: the {words} missing; the table has the columns {', '.join(header)}")
