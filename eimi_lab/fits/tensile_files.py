"""Read tensile tests from files in one of two formats.

database   Soft Robotics Materials Database (Marechal et al. 2020, doi 10.1089/soro.2019.0115), with `;` between cells
plain      a header with `strain` or `strain_percent`, and `stress_Pa`, `stress_kPa` or `stress_MPa`, then numbers
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.evidence.tensile_curves import TensileCurve
from eimi_fitting.units import PA_PER_MPA
from eimi_lab.config.csv_tables import Column, Row, read_table
from eimi_lab.config.toml import read_text
from eimi_lab.process.errors import InputError

Array = NDArray[np.float64]

STRAINS = {"strain": 1.0, "strain_percent": 1e-2}
STRESSES = {"stress_Pa": 1.0, "stress_kPa": 1e3, "stress_MPa": PA_PER_MPA}
COLUMNS = {
    "strain": Column("Engineering strain: elongation divided by the length without load.", "0.2"),
    "strain_percent": Column("Instead of strain: the strain in per cent.", "20"),
    "stress_Pa": Column("Engineering stress: force divided by the area without load.", "24000"),
    "stress_kPa": Column("Instead of stress_Pa.", "24"),
    "stress_MPa": Column("Instead of stress_Pa.", "0.024"),
}
MOST_STRAIN = 100.0  # 10 000 %; assumed: the softest gels tear below a strain of 30 (3000 %)
LIKELY_PERCENT = 15.0
"""Largest plausible strain as a fraction. Silicones are assumed to tear below a strain of 12 (1200 %), so that a larger
number is probably in per cent.
"""
MOST_STRESS_PA = 1e12  # about Young's modulus of diamond, which no stress in a silicone reaches
WINDOWS = ("20", "50", "100", "full")
_ROWS = 5  # fewest rows of a curve in its window, from which its noise can be estimated
_DATABASE_STRAIN, _DATABASE_STRESS = "Engineering Strain", "Engineering Stress (MPa)"


@dataclass(frozen=True)
class TensileTest:
    """A tensile test of m rows: engineering strain, shape (m,), and engineering stress in Pa, shape (m,)."""

    path: Path
    sha256: str
    material: str | None
    strain: Array
    stress_Pa: Array


@dataclass(frozen=True)
class FileCurve(TensileCurve):
    """A tensile curve from the file `path`, up to the strain `window_percent` (None for the whole curve)."""

    path: str = ""
    sha256: str = ""
    window_percent: float | None = None


def read_curve(path: Path, percent: float | None, weight: float) -> FileCurve:
    """Read a tensile curve up to a largest strain, for a joint fit with datasets.

    Parameters
    ----------
    path : Path
        File of the tensile test.
    percent : float or None
        Largest strain in per cent; None for the whole curve.
    weight : float
        Factor of the weight of the curve in the joint fit.

    Raises
    ------
    InputError
        If the file cannot be read, or if fewer than five rows remain.
    """
    test = read_tensile(path)
    inside = np.abs(test.strain) <= (float("inf") if percent is None else percent / 100)
    if inside.sum() < _ROWS:
        raise InputError(f"{path}: {inside.sum()} rows up to the largest strain to fit; a fit needs at least {_ROWS}")
    return FileCurve(test.strain[inside], test.stress_Pa[inside], weight, str(path), test.sha256, percent)


def read_tensile(path: Path) -> TensileTest:
    """Read a tensile test from a file with two columns, or from a file of the Soft Robotics Materials Database.

    Raises InputError with the file, the row and the value.
    """
    text = read_text(path)
    header = [cell.strip() for cell in re.split("[,;\t]", text.removeprefix("\ufeff").partition("\n")[0])]
    if ";" in text.partition("\n")[0] and not {*STRAINS, *STRESSES} & {*header}:
        rows, material = _database_rows(path, text)
        strain_name, stress_name, strain_unit, stress_unit = _DATABASE_STRAIN, _DATABASE_STRESS, 1.0, PA_PER_MPA
    else:
        strain_name, stress_name = _only(path, header, STRAINS), _only(path, header, STRESSES)
        strain_unit, stress_unit = STRAINS[strain_name], STRESSES[stress_name]
        rows, material = read_table(path, [strain_name, stress_name]), None
    strain = np.array([row.number(strain_name) for row in rows]) * strain_unit
    with np.errstate(over="ignore"):  # refused below
        stress_Pa = np.array([row.number(stress_name) for row in rows]) * stress_unit
    if strain_name == "strain" and LIKELY_PERCENT < strain.max() <= 100 * MOST_STRAIN:
        row = rows[int(strain.argmax())]
        raise row.fault(
            "strain",
            f"a fraction, and {strain.max():g} would be {100 * strain.max():g} %; if the column is "
            "in per cent, name it strain_percent",
        )
    for row, e, sigma in zip(rows, strain, stress_Pa, strict=True):
        if not -1 < e <= MOST_STRAIN:
            raise row.fault(strain_name, f"an engineering strain above -1 (-100 %) and at most {MOST_STRAIN:g}")
        if abs(sigma) > MOST_STRESS_PA:
            raise row.fault(stress_name, f"a stress of at most {MOST_STRESS_PA:g} Pa")
    return TensileTest(path, hashlib.sha256(path.read_bytes()).hexdigest(), material, strain, stress_Pa)


def _only(path: Path, header: list[str], names: dict[str, float]) -> str:
    """Return the one column in `header` that is also in `names`. Raises InputError for no or several such columns."""
    present = [name for name in names if name in header]
    if len(present) != 1:
        raise InputError(
            f"{path}: row 1: {','.join(header)!r} should have one of {', '.join(STRAINS)} "
            f"and one of {', '.join(STRESSES)}, such as strain,stress_MPa"
        )
    return present[0]


def _database_rows(path: Path, text: str) -> tuple[list[Row], str | None]:
    """Return the rows of a tensile test in the Soft Robotics Materials Database, and the material's name or None."""
    columns: list[str] | None = None
    material, rows = None, []
    for line, words in enumerate(text.removeprefix("\ufeff").splitlines(), 1):
        cells = [cell.strip() for cell in words.split(";")]
        if columns is None:
            if _DATABASE_STRAIN in cells and _DATABASE_STRESS in cells:
                columns = cells
            elif cells[0] == "Material" and len(cells) > 1:
                material = cells[1] or None
        elif any(cells):
            if len(cells) != len(columns):
                raise InputError(f"{path}: row {line}: has {len(cells)} cells; the header has {len(columns)} columns")
            rows.append(Row(path, line, dict(zip(columns, cells, strict=True)), decimal_comma=True))
    if columns is None:
        raise InputError(
            f"{path}: has no header with the columns {_DATABASE_STRAIN} and {_DATABASE_STRESS}; a file with two "
            "columns should have commas between them and a first row such as strain,stress_MPa"
        )
    if not rows:
        raise InputError(f"{path}: has a header but no rows")
    return rows, material


def check_windows(windows: list[str], option: str = "--window") -> list[float | None]:
    """Convert the values of an option (largest strains of the fitted data) into numbers, without repetitions.

    "full", the whole curve, becomes None. Raises InputError for another text that is not a number above 0.
    """
    checked: list[float | None] = []
    for window in windows:
        try:
            percent = None if window == "full" else float(window)
        except ValueError:
            percent = -1.0
        if percent is not None and not 0 < percent < np.inf:
            raise InputError(f"{option} {window}: should be a strain in percent above 0, or full")
        if percent not in checked:
            checked.append(percent)
    return checked
