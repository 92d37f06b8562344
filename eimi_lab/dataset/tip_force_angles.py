"""Store and read the directions of the tip forces in a dataset.

A dataset contains no directions if all tip forces have the direction of gravity.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from eimi_lab.process.replacing import patiently

NAME = "tip_force_angle"


def store_tip_force_angles(path: Path, angles_deg: Sequence[float | None]) -> None:
    """Add the direction of the tip force of each state (load step) to an existing dataset file.

    The angles are in degrees, from +x toward +y in the beam frame (x along the straight beam from the clamp, y across).
    None means the direction of gravity. If every angle is None, the file is not changed.
    """
    if any(angle is not None for angle in angles_deg):
        with patiently(lambda: h5py.File(path, "r+")) as file:
            write_tip_force_angles(file["entry/states"], angles_deg)


def write_tip_force_angles(states: h5py.Group, angles_deg: Sequence[float | None]) -> None:
    """Write the direction of the tip force of each state (load step), in degrees from +x toward +y in the beam frame.

    In the beam frame, x runs along the straight beam from the clamp, and y across the beam. The value None means the
    direction of gravity, and is stored as NaN. Nothing is written if every value is None.
    """
    if any(angle is not None for angle in angles_deg):
        values = np.array([np.nan if angle is None else angle for angle in angles_deg])
        states.create_dataset(NAME, data=values).attrs["units"] = "deg"


def tip_force_angles(states: h5py.Group, count: int) -> NDArray[np.float64]:
    """Return the directions of the tip forces of all states (load steps), shape (count,), in degrees from +x toward +y.

    The angles are in the beam frame (x along the straight beam from the clamp, y across); NaN means the direction of
    gravity. ``count`` is the number of states.
    """
    return np.asarray(states[NAME][()]) if NAME in states else np.full(count, np.nan)
