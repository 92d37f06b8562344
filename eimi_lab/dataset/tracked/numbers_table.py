"""Read tables of numbers that other programs export as text, with empty cells and decimal points or commas."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eimi_lab.config.toml import read_text
from eimi_lab.process.errors import InputError

_NOTHING = frozenset({"", "nan", "NaN", "NAN", "Inf", "-Inf", "null"})


def read_cells(path: Path, separators: str = ",;\t", comment: str = "#") -> list[tuple[int, list[str]]]:
    """Return the cells of a table in a text file.

    Parameters
    ----------
    path
        The file.
    separators
        Possible separators of cells; the most frequent one is used.
    comment
        Lines that start with this text are skipped.

    Returns
    -------
    list of (int, list of str)
        The number and the cells of each line that is not empty.

    Raises
    ------
    InputError
        If the file cannot be read, is empty, or does not contain a table as text.
    """
    lines = ["" if line.startswith(comment) else line for line in read_text(path).removeprefix("\ufeff").splitlines()]
    head = "\n".join([line for line in lines if line.strip()][:5])
    separator = max(separators, key=head.count)
    try:
        rows = csv.reader(lines, delimiter=separator)
        cells = [(rows.line_num, [cell.strip() for cell in row]) for row in rows]
    except csv.Error as error:
        raise InputError(f"{path}: is not a text file with a table ({error})") from error
    filled = [(number, row) for number, row in cells if any(row)]
    if not filled:
        raise InputError(f"{path}: is empty")
    return filled


def numbers(path: Path, line: int, cells: Sequence[str]) -> NDArray[np.float64]:
    """Convert n cells of a table into numbers, shape (n,); NaN for an empty cell. Decimal commas are allowed.

    Raises InputError, which names the line, for a cell that is not a number.
    """
    values = []
    for cell in cells:
        try:
            value = math.nan if cell in _NOTHING else float(cell.replace(",", "."))
        except ValueError:
            raise InputError(f"{path}: line {line}: {cell!r} should be a number") from None
        values.append(value)
    return np.array(values)


def refused(path: Path, tool: str, expected: str) -> InputError:
    """Return the error for a file that the tracking program ``tool`` did not write; ``expected`` is a sentence."""
    return InputError(f"{path}: is not a file of {tool}: {expected}")
