"""Directions of tip forces, kept beside the table of states where they are not all along gravity."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

NAME = "tip_force_angle"


def store_tip_force_angles(path: Path, angles_deg: Sequence[float | None]) -> None:
    """Put them into a dataset that is there already."""
    if any(angle is not None for angle in angles_deg):
        with h5py.File(path, "r+") as file:
            write_tip_force_angles(file["entry/states"], angles_deg)


def write_tip_force_angles(states: h5py.Group, angles_deg: Sequence[float | None]) -> None:
    """Write one direction a state, in the beam frame, NaN for along gravity; nothing where all are."""
    if any(angle is not None for angle in angles_deg):
        values = np.array([np.nan if angle is None else angle for angle in angles_deg])
        states.create_dataset(NAME, data=values).attrs["units"] = "deg"


def tip_force_angles(states: h5py.Group, count: int) -> NDArray[np.float64]:
    """(count,) degrees, NaN for along gravity."""
    return np.asarray(states[NAME][()]) if NAME in states else np.full(count, np.nan)
