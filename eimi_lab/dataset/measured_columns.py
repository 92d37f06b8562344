"""Store and read two quantities of imported states: uncertainty of the field, and temperature of the specimen."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import h5py
import numpy as np
from numpy.typing import NDArray

COLUMNS = {"field_sigma": ("field_sigma_mT", "mT"), "temperature": ("temperature_degC", "degC")}
"""For each column in the file, the attribute of `Measured` that holds the values, and the unit."""


class Measured(Protocol):
    """The measured quantities of an imported state: uncertainty of the field, and temperature of the specimen.

    A quantity that was not measured is None.
    """

    @property
    def field_sigma_mT(self) -> float | None:
        """Standard uncertainty of the measured field, mT."""

    @property
    def temperature_degC(self) -> float | None:
        """Temperature of the specimen, °C."""


def store_measured_columns(path: Path, loads: Sequence[Measured]) -> None:
    """Add the measured quantities of all states to an existing dataset file, see `write_measured_columns`."""
    with h5py.File(path, "r+") as file:
        write_measured_columns(file["entry/states"], loads)


def write_measured_columns(states: h5py.Group, loads: Sequence[Measured]) -> None:
    """Write a column to the table of states for each quantity of `COLUMNS` that was measured in at least one state.

    The column contains NaN for a state in which the quantity was not measured.
    """
    for name, (key, unit) in COLUMNS.items():
        values = [getattr(load, key) for load in loads]
        if any(value is not None for value in values):
            stored = np.array([np.nan if value is None else value for value in values])
            states.create_dataset(name, data=stored).attrs["units"] = unit


def measured_column(states: h5py.Group, name: str, count: int) -> NDArray[np.float64]:
    """Return a measured quantity of all states, shape (count,); NaN for a state in which it was not measured.

    ``states`` is the table of states, ``name`` is a key of `COLUMNS`, and ``count`` is the number of states.
    """
    return np.asarray(states[name][()]) if name in states else np.full(count, np.nan)
