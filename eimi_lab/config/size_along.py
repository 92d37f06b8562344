"""A width or depth of the beam: a number, or a table of sizes against the arc length."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from pydantic import ValidatorFunctionWrapHandler

Rows = tuple[tuple[float, float], ...]


class SizeAlong(float):
    """A width or depth (mm) that varies along the beam; as a number, the mean along the beam.

    Parameters
    ----------
    rows : tuple of (float, float)
        Pairs of arc length from the clamp and size, both in mm. Between two rows the size changes linearly.
    """

    rows: Rows

    def __new__(cls, rows: Rows) -> SizeAlong:
        """Return the mean size along the beam (mm), a number that also stores `rows` (arc length, size)."""
        along, sizes = np.array(rows).T
        size = super().__new__(cls, np.trapezoid(sizes, along) / (along[-1] - along[0]))
        size.rows = rows
        return size


def rows_of(size_mm: float) -> Rows:
    """Return the rows (arc length, size) in mm of a `SizeAlong`, and an empty tuple for a constant width or depth."""
    return size_mm.rows if isinstance(size_mm, SizeAlong) else ()


def size_along(value: Any, number: ValidatorFunctionWrapHandler) -> float:
    """Check a width or depth in a file, and return it as a number, or as `SizeAlong` if the file gives a table.

    Parameters
    ----------
    value
        The value in the file: a number, or a list of rows [arc length, size], both in mm.
    number
        Function of pydantic that checks and returns a number.

    Raises
    ------
    ValueError
        If the table is wrong.
    """
    if not isinstance(value, list | tuple):
        return number(value)
    rows = []
    for row in value:
        if not isinstance(row, list | tuple) or len(row) != 2:
            raise ValueError(f"a row of the table should be [arc length, size] in mm, not {row!r}")
        try:
            rows.append((float(row[0]), number(row[1])))
        except (TypeError, OverflowError) as error:
            raise ValueError(f"a row of the table should be [arc length, size] in mm, not {row!r}") from error
    if len(rows) < 2 or rows[0][0] != 0:
        raise ValueError("should have at least two rows, and the arc length of the first row should be 0")
    for (before, _), (after, _) in pairwise(rows):
        if not after >= before:
            raise ValueError(f"should have increasing arc lengths, but {after:g} follows {before:g}")
    if any(first[0] == third[0] for first, third in zip(rows, rows[2:], strict=False)) or not rows[-1][0] > rows[-2][0]:
        raise ValueError(
            "should have at most two rows with the same arc length, and only one row with the last arc length"
        )
    return SizeAlong(tuple(rows))


def written(size_mm: float) -> float | list[list[float]]:
    """Return a width or depth (mm) for a file: a number, or the rows [arc length, size] of a `SizeAlong`."""
    return [list(row) for row in size_mm.rows] if isinstance(size_mm, SizeAlong) else float(size_mm)
