"""Tables of numbers that other programs export: cells that may be empty, and numbers of any locale."""

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
    """Every line that is neither empty nor a comment with its number, cut at the separator that is most frequent first.

    Raises InputError.
    """
    lines = ["" if line.startswith(comment) else line for line in read_text(path).removeprefix("\ufeff").splitlines()]
    head = "\n".join([line for line in lines if line.strip()][:5])
    separator = max(separators, key=head.count)
    try:
        rows = csv.reader(lines, delimiter=separator)
        cells = [(rows.line_num, [cell.strip() for cell in row]) for row in rows]
    except csv.Error as error:
        raise InputError(f"{path}: is no table of text ({error})") from error
    found = [(number, row) for number, row in cells if any(row)]
    if not found:
        raise InputError(f"{path}: is empty")
    return found


def numbers(path: Path, line: int, cells: Sequence[str]) -> NDArray[np.float64]:
    """(n,) the numbers of some cells, NaN for an empty one; a decimal comma is read too. Raises InputError."""
    found = []
    for cell in cells:
        try:
            value = math.nan if cell in _NOTHING else float(cell.replace(",", "."))
        except ValueError:
            raise InputError(f"{path}: line {line}: {cell!r} should be a number") from None
        found.append(value)
    return np.array(found)


def refused(path: Path, tool: str, wanted: str) -> InputError:
    """The error for a file that is not what the tool writes."""
    return InputError(f"{path}: is no file of {tool}: {wanted}")
