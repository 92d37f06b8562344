"""Read the loads and the flags (names of defects) of the load steps from a dataset."""

from __future__ import annotations

import math
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from eimi_lab.dataset.layout import Kind, flags_from_text
from eimi_lab.dataset.measured_columns import measured_column
from eimi_lab.dataset.measured_field import FieldLine, measured_line
from eimi_lab.dataset.sensor_logs import read_sensor_logs
from eimi_lab.dataset.state import State
from eimi_lab.dataset.tip_force_angles import tip_force_angles
from eimi_lab.process.errors import InputError


def read_states(path: Path, entry: h5py.Group, kind: Kind) -> tuple[tuple[State, ...], FieldLine | None]:
    """Return the load steps of a dataset, and the straight line of its gaussmeter readings against current.

    Parameters
    ----------
    path : Path
        The file, for the message of an error.
    entry : h5py.Group
        The HDF5 group that contains the whole dataset.
    kind : str
        ``"frames"`` for a dataset of frames, ``"points"`` for a dataset of tracked points.

    Returns
    -------
    states : tuple of State
        The load steps in their order.
    line : FieldLine or None
        None without a gaussmeter.

    Raises
    ------
    InputError
        If the numbers of the load steps are damaged.
    """
    table = entry["states"]
    indices = table["index"][()]
    count = len(indices)
    if not np.array_equal(indices, np.arange(count)):
        raise InputError(
            f"{path}: the numbers of the states in the file are damaged; `eimi recover` may repair them in a new file"
        )
    angles = tip_force_angles(table, count)
    sigmas, temperatures = (measured_column(table, name, count) for name in ("field_sigma", "temperature"))
    fields, currents = table["field"][:count], table["current"][:count]
    logs = read_sensor_logs(entry, count) if kind == "frames" else ()
    line = measured_line(logs, currents)
    if line is not None:
        fields = line.mT_per_A * currents
    for log in logs:
        if log.sensor.measures == "specimen_temperature":
            temperatures = log.by_state(count)
    measured = mean_by_state(entry, "measured_current", count) if kind == "frames" else np.full(count, np.nan)
    states = tuple(
        State(
            index=int(index),
            current_A=_none_if_nan(currents[index]),
            measured_A=_none_if_nan(measured[index]),
            field_mT=float(fields[index]),
            tip_force_N=float(table["tip_force"][index]),
            flags=flags_from_text(table["flags"][index]),
            tip_force_angle_deg=_none_if_nan(angles[index]),
            field_sigma_mT=_none_if_nan(sigmas[index]),
            temperature_degC=_none_if_nan(temperatures[index]),
        )
        for index in indices
    )
    return states, line


def mean_by_state(entry: h5py.Group, name: str, count: int) -> NDArray[np.float64]:
    """Return the mean of a quantity over the frames of each load step, shape (count,); NaN without frames.

    Parameters
    ----------
    entry : h5py.Group
        The HDF5 group that contains a whole dataset of frames.
    name : str
        The quantity: "time" or "measured_current".
    count : int
        Number of load steps.
    """
    of_state, values = entry["data/state"][()], entry[f"data/{name}"][()]
    rows = min(len(of_state), len(values))
    complete = np.isin(of_state[:rows], np.arange(count))
    of_state, values = of_state[:rows][complete], values[:rows][complete]
    frames = np.bincount(of_state, minlength=count)
    totals = np.bincount(of_state, weights=values, minlength=count)
    return np.divide(totals, frames, out=np.full(count, np.nan), where=frames > 0)


def _none_if_nan(value: float) -> float | None:
    return None if math.isnan(value) else float(value)
