"""Store and read the directions of the tip forces. A dataset has none if all have the direction of gravity."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from eimi_lab.process.replacing import patiently

NAME = "tip_force_angle"


def store_tip_force_angles(path: Path, angles_deg: Sequence[float | None]) -> None:
    """Add the direction of the tip force of each load step to an existing dataset file.

    Angles are in degrees, from +x (along the straight beam) toward +y (across it); None is the direction of gravity.
    """
    if any(angle is not None for angle in angles_deg):
        with patiently(lambda: h5py.File(path, "r+")) as file:
            write_tip_force_angles(file["entry/states"], angles_deg)


def write_tip_force_angles(states: h5py.Group, angles_deg: Sequence[float | None]) -> None:
    """Write the direction of the tip force of each load step, unless every value is None (the direction of gravity).

    Angles are in degrees, from +x (along the straight beam) toward +y (across it).
    """
    if any(angle is not None for angle in angles_deg):
        values = np.array([np.nan if angle is None else angle for angle in angles_deg])
        states.create_dataset(NAME, data=values).attrs["units"] = "deg"


def tip_force_angles(states: h5py.Group, count: int) -> NDArray[np.float64]:
    """Return the direction of the tip force in each load step, shape (count,); NaN for the direction of gravity.

    Angles are in degrees, from +x (along the straight beam) toward +y (across it).
    """
    return np.asarray(states[NAME][()]) if NAME in states else np.full(count, np.nan)
