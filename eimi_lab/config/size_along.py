"""A width or depth of the beam that may vary along its length: a number, or a table over the arc length."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from pydantic import ValidatorFunctionWrapHandler

Rows = tuple[tuple[float, float], ...]


class SizeAlong(float):
    """A width or depth in mm that varies along the beam. The value as a number is the mean over the arc length.

    Parameters
    ----------
    rows : tuple of (float, float)
        Arc length from the clamp and size, both in mm. Between two rows the size changes linearly. Two rows with the
        same arc length are a step.
    """

    rows: Rows

    def __new__(cls, rows: Rows) -> SizeAlong:
        """Return the mean of a width or depth over the arc length, as a number with the table as attribute `rows`."""
        along, sizes = np.array(rows).T
        size = super().__new__(cls, np.trapezoid(sizes, along) / (along[-1] - along[0]))
        size.rows = rows
        return size


def rows_of(size_mm: float) -> Rows:
    """Return the table of a width or depth over the arc length; an empty tuple if the size is constant."""
    return size_mm.rows if isinstance(size_mm, SizeAlong) else ()


def size_along(value: Any, number: ValidatorFunctionWrapHandler) -> float:
    """Return the width or depth that a file gives as a number or as a table over the arc length.

    Parameters
    ----------
    value
        The value in the file.
    number
        Function that checks a number.

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
    """Return a width or depth as a file contains it: a number, or a table of rows [arc length, size]."""
    return [list(row) for row in size_mm.rows] if isinstance(size_mm, SizeAlong) else float(size_mm)
