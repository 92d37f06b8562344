"""The table [field] of a calibration, which gives the field of the coil as a function of position."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from eimi_fitting.beam.coil_field import CoilShape, FieldTable
from eimi_fitting.beam.specimen import Specimen
from eimi_lab.config.csv_tables import read_table
from eimi_lab.config.toml import Table
from eimi_lab.process.paths import named_in

_REACH = 1.15  # the field of the loops is tabulated up to this distance, in lengths of the beam
_LEAST = 4  # smallest number of different x and of different y in a map
_NO_FIELD = 1e-9  # smallest field at the magnet, as a share of the largest field in a map
_MOST_ROWS = 10_000
_COLUMNS = ("x_mm", "y_mm", "bx_mT", "by_mT")

Pair = Annotated[tuple[float, float], Field(strict=False)]
Row = Annotated[tuple[float, float, float, float], Field(strict=False)]


class CoilShapeTable(Table):
    """The field of the coil as a function of position, relative to the field at the magnet.

    The table contains two circular loops of wire, or a map (the measured field at the points of a grid), or a gradient.
    Positions are in the beam frame: x along the straight beam from the clamp, y across the beam.
    """

    radius_mm: float | None = Field(default=None, gt=0)
    """Radius of two equal coaxial loops, whose axis has the direction field_angle_deg."""
    gap_mm: float | None = Field(default=None, ge=0)
    """Distance between the planes of the loops; equal to the radius for a Helmholtz coil, 0 for a single loop."""
    centre_mm: Pair | None = None
    """Point half-way between the loops, along and across the beam; by default the point to which
    coil_constant_mT_per_A applies.
    """
    map: Annotated[tuple[Row, ...], Field(strict=False, max_length=_MOST_ROWS)] | None = None
    """Measured field: name of a CSV file in the same folder, with the columns x_mm, y_mm, bx_mT and by_mT at the points
    of a rectangular grid. The program copies the rows of the file into the dataset.
    """
    gradient_per_m: Pair | None = None
    """Relative change of the strength of the field per metre along and across the beam. The gradient can be given
    alone, or in addition to the loops or the map.
    """
    against_current: Annotated[tuple[Pair, ...], Field(strict=False, max_length=_MOST_ROWS)] | None = None
    """Currents (A) and readings of a gaussmeter (mT) from which `eimi calibrate-coil` computed the coil constant. They
    are stored only for information.
    """

    @model_validator(mode="after")
    def _consistent(self) -> CoilShapeTable:
        if (self.radius_mm is None) != (self.gap_mm is None):
            raise ValueError("radius_mm and gap_mm belong together: give both keys or none of them")
        if self.radius_mm is not None and self.map is not None:
            raise ValueError("has both radius_mm and map; give only one of these keys")
        if self.centre_mm is not None and self.radius_mm is None:
            raise ValueError("centre_mm is the centre of the loops; also give radius_mm and gap_mm")
        if not self.is_uneven and self.against_current is None:
            raise ValueError(
                "has no shape of the field; give radius_mm and gap_mm (two loops), or map, or gradient_per_m"
            )
        if self.map is not None:
            self._grid()
        return self

    @property
    def is_uneven(self) -> bool:
        """Whether the field varies with the position."""
        return not (self.radius_mm is None and self.map is None and self.gradient_per_m is None)

    def _grid(self) -> FieldTable:
        rows = np.array(sorted(self.map or ()))
        x, y = (np.unique(rows[:, i]) for i in range(2))
        if len(rows) != len(x) * len(y) or min(len(x), len(y)) < _LEAST:
            raise ValueError(
                f"map has {len(rows)} rows with {len(x)} different x and {len(y)} different y; it should have one row "
                f"for each pair of x and y, and at least {_LEAST} different x and {_LEAST} different y"
            )
        return FieldTable(x, y, rows[:, 2:].reshape(len(x), len(y), 2))

    def shape(self, specimen: Specimen, field_deg: float) -> CoilShape:
        """Return the field of the coil as a function of position, in the form for the simulation of a specimen.

        Parameters
        ----------
        specimen
            The specimen.
        field_deg
            Direction of the field of a positive current, degrees from +x (along the straight beam from the clamp)
            toward +y (across the beam).

        Raises
        ------
        ValueError
            If a loop of the coil passes through the beam, if the magnet at rest is outside the map of the field, or if
            the map has no field there.
        """
        axis = (math.cos(math.radians(field_deg)), math.sin(math.radians(field_deg)))
        rest = np.array([specimen.field_place_mm, 0.0])
        table = None
        if self.radius_mm is not None and self.gap_mm is not None:
            centre = self.centre_mm or (float(rest[0]), 0.0)
            table = FieldTable.of_loops(self.radius_mm, self.gap_mm, centre, axis, _REACH * specimen.length_mm)
        elif self.map is not None:
            table = self._grid()
            if not table.covers(rest[None]):
                raise ValueError(f"the field map does not cover the magnet at rest, x_mm = {rest[0]:g}, y_mm = 0")
            if not abs(table.derivatives(rest[None])[0, 0]) > _NO_FIELD * np.abs(table.field).max():
                raise ValueError(
                    f"the field map has no field at the magnet at rest, x_mm = {rest[0]:g}, y_mm = 0, but the field at "
                    "other points is relative to it: give the field of a current that is not zero"
                )
        return CoilShape(axis, self.gradient_per_m or (0.0, 0.0), table)


def with_rows_of_map(table: dict[str, Any], beside: Path) -> bool:
    """Replace the name of a map file (the measured field at the points of a grid) by the rows of the file.

    Return False if the calibration names no map file.

    Parameters
    ----------
    table
        The contents of the calibration file, which are changed in place.
    beside
        Path of the calibration file, in whose folder the map file is.

    Raises
    ------
    InputError
        If the map file cannot be read, or does not have the required columns.
    """
    field = table.get("field")
    if not isinstance(field, dict) or not isinstance(field.get("map"), str):
        return False
    file = named_in(beside, field["map"])
    rows = [[row.number(column) for column in _COLUMNS] for row in read_table(file, _COLUMNS)]
    table["field"] = {**field, "map": rows}
    return True
