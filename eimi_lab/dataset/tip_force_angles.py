"""Directions of tip forces in a dataset file, stored beside the table of states unless all forces are along gravity."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

NAME = "tip_force_angle"


def store_tip_force_angles(path: Path, angles_deg: Sequence[float | None]) -> None:
    """Write the directions into an existing dataset, as `write_tip_force_angles` does."""
    if any(angle is not None for angle in angles_deg):
        with h5py.File(path, "r+") as file:
            write_tip_force_angles(file["entry/states"], angles_deg)


def write_tip_force_angles(states: h5py.Group, angles_deg: Sequence[float | None]) -> None:
    """Write the direction of each state's tip force, in degrees in the beam frame.

    None stands for the direction of gravity and is stored as NaN. If every direction is None, nothing is written.
    """
    if any(angle is not None for angle in angles_deg):
        values = np.array([np.nan if angle is None else angle for angle in angles_deg])
        states.create_dataset(NAME, data=values).attrs["units"] = "deg"


def tip_force_angles(states: h5py.Group, count: int) -> NDArray[np.float64]:
    """Return the directions (count,) in degrees in the beam frame; NaN stands for the direction of gravity."""
    return np.asarray(states[NAME][()]) if NAME in states else np.full(count, np.nan)
