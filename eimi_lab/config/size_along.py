"""A size of the beam that may vary along it: a number, or a table over the arc length."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from pydantic import ValidatorFunctionWrapHandler

Rows = tuple[tuple[float, float], ...]


class SizeAlong(float):
    """The mean of a table over the arc length, in mm, with the table.

    Parameters
    ----------
    rows : tuple of (float, float)
        Arc length and size in mm; straight lines connect the rows, and two rows at one arc length are a step.
    """

    rows: Rows

    def __new__(cls, rows: Rows) -> SizeAlong:
        """Return the mean over the arc length as a number that keeps the table."""
        along, sizes = np.array(rows).T
        size = super().__new__(cls, np.trapezoid(sizes, along) / (along[-1] - along[0]))
        size.rows = rows
        return size


def rows_of(size_mm: float) -> Rows:
    """Return the table of a size; an empty table if the size is the same everywhere."""
    return size_mm.rows if isinstance(size_mm, SizeAlong) else ()


def size_along(value: Any, number: ValidatorFunctionWrapHandler) -> float:
    """Validate a size: a number by the validator of numbers, or a table. Raises ValueError for a wrong table."""
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
        raise ValueError("a table should have at least two rows, of which the first is at arc length 0")
    for (before, _), (after, _) in pairwise(rows):
        if not after >= before:
            raise ValueError(f"the arc lengths of a table should rise, but {after:g} follows {before:g}")
    if any(first[0] == third[0] for first, third in zip(rows, rows[2:], strict=False)) or not rows[-1][0] > rows[-2][0]:
        raise ValueError("a table should have at most two rows at one arc length, and one at its end")
    return SizeAlong(tuple(rows))


def written(size_mm: float) -> float | list[list[float]]:
    """Return a size in the form of the file: a number or a table."""
    return [list(row) for row in size_mm.rows] if isinstance(size_mm, SizeAlong) else float(size_mm)
