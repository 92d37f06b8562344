"""Uncertainties of measured fields, and measured temperatures, of imported states, stored beside their table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import h5py
import numpy as np
from numpy.typing import NDArray

COLUMNS = {"field_sigma": ("field_sigma_mT", "mT"), "temperature": ("temperature_degC", "degC")}
"""The attribute of a load and the unit, by the name in the file."""


class Measured(Protocol):
    """The load of a state with its measured quantities; None for a quantity that was not measured."""

    @property
    def field_sigma_mT(self) -> float | None:
        """Standard uncertainty of the field."""

    @property
    def temperature_degC(self) -> float | None:
        """Temperature of the specimen."""


def store_measured_columns(path: Path, loads: Sequence[Measured]) -> None:
    """Write the measured columns into an existing dataset, as `write_measured_columns` does."""
    with h5py.File(path, "r+") as file:
        write_measured_columns(file["entry/states"], loads)


def write_measured_columns(states: h5py.Group, loads: Sequence[Measured]) -> None:
    """Write each column of `COLUMNS` that any state has; NaN for a state without a value."""
    for name, (key, unit) in COLUMNS.items():
        values = [getattr(load, key) for load in loads]
        if any(value is not None for value in values):
            stored = np.array([np.nan if value is None else value for value in values])
            states.create_dataset(name, data=stored).attrs["units"] = unit


def measured_column(states: h5py.Group, name: str, count: int) -> NDArray[np.float64]:
    """Return a column of `COLUMNS`, (count,); NaN where nothing was measured."""
    return np.asarray(states[name][()]) if name in states else np.full(count, np.nan)
