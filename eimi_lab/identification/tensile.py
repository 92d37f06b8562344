"""Tensile tests from files to fits: the conventional route, what `eimi tensile` does.

Two formats are read, told apart by the first line:

database   `;` between cells, information about the test first, then a header with `Engineering Strain` and
           `Engineering Stress (MPa)`: the Soft Robotics Materials Database (Marechal et al. 2020,
           doi 10.1089/soro.2019.0115)
plain      `,` between cells, a header of two names: `strain` or `strain_percent`, and `stress_Pa`, `stress_kPa` or
           `stress_MPa`, both engineering values
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.stability import LARGEST_STRETCH_CHECKED
from eimi_fitting.tensile import CannotFit, fit_tensile
from eimi_lab.config.reading import read_text
from eimi_lab.dataset.tables import Row, read_table
from eimi_lab.errors import InputError
from eimi_lab.identification.records import Quantity, Stability, TensileRecord, TensileSource, package_versions

Array = NDArray[np.float64]

STRAINS = {"strain": 1.0, "strain_percent": 1e-2}
STRESSES = {"stress_Pa": 1.0, "stress_kPa": 1e3, "stress_MPa": 1e6}
WINDOWS = ("20", "50", "100", "full")
_DATABASE_STRAIN, _DATABASE_STRESS = "Engineering Strain", "Engineering Stress (MPa)"


@dataclass(frozen=True)
class TensileTest:
    """A tensile test: engineering strain (m,) and engineering stress (m,) in Pa, in the order of the file."""

    path: Path
    sha256: str
    material: str | None
    strain: Array
    stress_Pa: Array


def read_tensile(path: Path) -> TensileTest:
    """Read a tensile test of either format. Raises InputError naming file, row and value."""
    text = read_text(path)
    if ";" in text.partition("\n")[0]:
        rows, material = _database_rows(path, text)
        strain_name, stress_name, strain_unit, stress_unit = _DATABASE_STRAIN, _DATABASE_STRESS, 1.0, 1e6
    else:
        header = [cell.strip() for cell in text.removeprefix("\ufeff").partition("\n")[0].split(",")]
        strain_name, stress_name = _only(path, header, STRAINS), _only(path, header, STRESSES)
        strain_unit, stress_unit = STRAINS[strain_name], STRESSES[stress_name]
        rows, material = read_table(path, [strain_name, stress_name]), None
    strain = np.array([row.number(strain_name) for row in rows]) * strain_unit
    stress = np.array([row.number(stress_name) for row in rows]) * stress_unit
    for row, e in zip(rows, strain, strict=True):
        if e <= -1:
            raise row.fault(strain_name, "an engineering strain above -1 (-100 %)")
    return TensileTest(path, hashlib.sha256(path.read_bytes()).hexdigest(), material, strain, stress)


def _only(path: Path, header: list[str], names: dict[str, float]) -> str:
    found = [name for name in names if name in header]
    if len(found) != 1:
        raise InputError(
            f"{path}: row 1: {','.join(header)!r} should be one of {', '.join(STRAINS)} "
            f"and one of {', '.join(STRESSES)}, such as strain,stress_MPa"
        )
    return found[0]


def _database_rows(path: Path, text: str) -> tuple[list[Row], str | None]:
    """The rows below the header of the columns, and the material that the information above it names."""
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
            rows.append(Row(path, line, dict(zip(columns, cells, strict=True))))
    if columns is None:
        raise InputError(
            f"{path}: has no header with the columns {_DATABASE_STRAIN} and {_DATABASE_STRESS}; a file of two columns "
            "has commas between them and a first row such as strain,stress_MPa"
        )
    if not rows:
        raise InputError(f"{path}: has a header but no rows")
    return rows, material


def check_windows(windows: list[str], option: str = "--window") -> list[float | None]:
    """Percentages, None for the whole curve, each once. Raises InputError."""
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


def fit_window(test: TensileTest, model: str, window_percent: float | None, relative: bool = False) -> TensileRecord:
    """Fit one law to one window of a test. Raises InputError."""
    largest = np.inf if window_percent is None else window_percent / 100
    try:
        fit = fit_tensile(model, test.strain, test.stress_Pa, largest_strain=largest, relative=relative)
    except CannotFit as error:
        window = "the whole curve" if window_percent is None else f"strains up to {window_percent:g} %"
        raise InputError(f"{test.path}: {window}: {error}") from error
    low, high = fit.initial_shear_modulus_interval_Pa
    return TensileRecord(
        model=model,
        parameters={
            name: Quantity(value=float(value), unit=unit, interval_95=(float(a), float(b)))
            for name, unit, value, (a, b) in zip(
                fit.law.parameter_names, fit.law.units, fit.parameters, fit.intervals, strict=True
            )
        },
        initial_shear_modulus=Quantity(value=fit.initial_shear_modulus_Pa, unit="Pa", interval_95=(low, high)),
        max_stretch=1 + fit.max_strain,
        stability=Stability(
            criterion="Drucker",
            stable_up_to_stretch=fit.stable_to,
            checked_up_to_stretch=LARGEST_STRETCH_CHECKED,
        ),
        versions=package_versions(),
        window_percent=window_percent,
        residuals="relative" if relative else "absolute",
        rmse_Pa=fit.rmse_Pa,
        rows=fit.rows,
        rows_left_out=fit.rows_left_out,
        correlation_rows=fit.correlation_rows,
        correlation=tuple(tuple(map(float, row)) for row in fit.correlation),
        not_fixed=fit.not_fixed,
        source=TensileSource(path=str(test.path), sha256=test.sha256, material=test.material),
    )
