"""Store and read two measured quantities of imported load steps: uncertainty of the field, and temperature."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import h5py
import numpy as np
from numpy.typing import NDArray

from eimi_lab.process.replacing import patiently

COLUMNS = {"field_sigma": ("field_sigma_mT", "mT"), "temperature": ("temperature_degC", "degC")}
"""For each column in the file, the attribute of `Measured` that holds the values, and the unit."""


class Measured(Protocol):
    """The measured quantities of an imported load step; None for a quantity that was not measured."""

    @property
    def field_sigma_mT(self) -> float | None:
        """Standard uncertainty of the measured field, mT."""

    @property
    def temperature_degC(self) -> float | None:
        """Temperature of the specimen, °C."""


def store_measured_columns(path: Path, loads: Sequence[Measured]) -> None:
    """Add field uncertainties and temperatures, one for each load step, to an existing dataset file."""
    with patiently(lambda: h5py.File(path, "r+")) as file:
        write_measured_columns(file["entry/states"], loads)


def write_measured_columns(states: h5py.Group, loads: Sequence[Measured]) -> None:
    """Write field uncertainties and temperatures to the table of load steps.

    A missing value is NaN; a quantity without any value gets no column.
    """
    for name, (key, unit) in COLUMNS.items():
        values = [getattr(load, key) for load in loads]
        if any(value is not None for value in values):
            stored = np.array([np.nan if value is None else value for value in values])
            states.create_dataset(name, data=stored).attrs["units"] = unit


def measured_column(states: h5py.Group, name: str, count: int) -> NDArray[np.float64]:
    """Return the field uncertainty (mT) or the temperature (°C) of each load step, shape (count,); NaN if not measured.

    ``states`` is the table of load steps in the file. ``name`` is "field_sigma" or "temperature".
    """
    return np.asarray(states[name][()]) if name in states else np.full(count, np.nan)
