"""The table [field] of a calibration: the field of the coil as a function of the place."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from eimi_fitting.beam.coil_field import CoilShape, FieldTable
from eimi_fitting.beam.specimen import Specimen
from eimi_lab.config.toml import Table, read_text
from eimi_lab.process.errors import InputError
from eimi_lab.process.paths import named_in

_REACH = 1.15  # lengths of the beam within which the field of the loops is tabulated
_LEAST = 4  # places along and across that a map needs
_MOST_ROWS = 10_000
_COLUMNS = ("x_mm", "y_mm", "bx_mT", "by_mT")

Pair = Annotated[tuple[float, float], Field(strict=False)]
Row = Annotated[tuple[float, float, float, float], Field(strict=False)]


class CoilShapeTable(Table):
    """The shape of the coil's field, in the plane of the beam and in the beam frame.

    Its strength follows from coil_constant_mT_per_A, which holds at the middle of the magnet at rest, or at the middle
    of the beam if there is no magnet. State two loops, a measured map, or only a gradient.
    """

    radius_mm: float | None = Field(default=None, gt=0)
    """Radius of two equal coaxial loops, whose axis has the direction field_angle_deg."""
    gap_mm: float | None = Field(default=None, ge=0)
    """Distance between the planes of the loops; equal to the radius for a Helmholtz coil, 0 for a single loop."""
    centre_mm: Pair | None = None
    """Point half-way between the loops, along and across the beam; by default the place of coil_constant_mT_per_A."""
    map: Annotated[tuple[Row, ...], Field(strict=False, max_length=_MOST_ROWS)] | None = None
    """Measured field: name of a CSV file beside this one with the columns x_mm, y_mm, bx_mT and by_mT on a rectangular
    grid. A dataset keeps its rows."""
    gradient_per_m: Pair | None = None
    """Change of the strength per metre along and across the beam, as a share; alone, or in addition to loops or map."""
    against_current: Annotated[tuple[Pair, ...], Field(strict=False, max_length=_MOST_ROWS)] | None = None
    """Currents (A) and readings of a gaussmeter (mT) from which `eimi calibrate-coil` took the coil constant; a record
    that changes nothing."""

    @model_validator(mode="after")
    def _consistent(self) -> CoilShapeTable:
        if (self.radius_mm is None) != (self.gap_mm is None):
            raise ValueError("radius_mm and gap_mm belong together: give both or neither")
        if self.radius_mm is not None and self.map is not None:
            raise ValueError("has both radius_mm and map; give one of them")
        if self.centre_mm is not None and self.radius_mm is None:
            raise ValueError("centre_mm is the centre of the loops; give radius_mm and gap_mm, too")
        if not self.is_uneven and self.against_current is None:
            raise ValueError("states nothing: give radius_mm and gap_mm, or map, or gradient_per_m")
        if self.map is not None:
            self._grid()
        return self

    @property
    def is_uneven(self) -> bool:
        """Whether the table states how the field changes from place to place."""
        return not (self.radius_mm is None and self.map is None and self.gradient_per_m is None)

    def _grid(self) -> FieldTable:
        rows = np.array(sorted(self.map or ()))
        x, y = (np.unique(rows[:, i]) for i in range(2))
        if len(rows) != len(x) * len(y) or min(len(x), len(y)) < _LEAST:
            raise ValueError(
                f"map has {len(rows)} rows at {len(x)} x and {len(y)} y; it should have one row for each pair of them, "
                f"and at least {_LEAST} of each"
            )
        return FieldTable(x, y, rows[:, 2:].reshape(len(x), len(y), 2))

    def shape(self, specimen: Specimen, field_deg: float) -> CoilShape:
        """Return the shape of the field for a specimen.

        Parameters
        ----------
        specimen
            The specimen.
        field_deg
            Direction of the positive field in the beam frame.

        Raises
        ------
        ValueError
            If a loop passes through the place of the beam, or the map does not cover the magnet.
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
                raise ValueError(f"the map does not cover the magnet at rest, x_mm = {rest[0]:g}, y_mm = 0")
        return CoilShape(axis, self.gradient_per_m or (0.0, 0.0), table)


def with_rows_of_map(table: dict[str, Any], beside: Path) -> bool:
    """Replace the name of a map file in the table of a calibration by the rows of that file; return whether it had one.

    Raises
    ------
    InputError
        If the file cannot be read or has other columns.
    """
    field = table.get("field")
    if not isinstance(field, dict) or not isinstance(field.get("map"), str):
        return False
    file = named_in(beside, field["map"])
    reader = csv.DictReader(io.StringIO(read_text(file)), skipinitialspace=True)
    if tuple(reader.fieldnames or ()) != _COLUMNS:
        raise InputError(f"{file}: the first row should be {','.join(_COLUMNS)}")
    rows = []
    for number, row in enumerate(reader, 2):
        try:
            rows.append([float(row[column]) for column in _COLUMNS])
        except (TypeError, ValueError) as error:
            raise InputError(f"{file}: row {number}: should be four numbers, {','.join(_COLUMNS)}") from error
    table["field"] = {**field, "map": rows}
    return True
