"""Datasets of tracked material points instead of frames. Motion capture or image correlation measured the points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from eimi_lab.dataset.layout import (
    WRITTEN_AS,
    Header,
    append,
    columns,
    flags_to_text,
    group,
    now,
    put_date,
    write_header,
    write_state_columns,
)
from eimi_lab.dataset.measured_columns import write_measured_columns
from eimi_lab.dataset.tip_force_angles import write_tip_force_angles
from eimi_lab.process.errors import InputError

Array = NDArray[np.float64]

# By definition of the beam frame, the field of a positive current points along +y.
FIELD_ANGLE_DEG = 90.0

NAME_BYTES = 64

POINT_COLUMNS: dict[str, tuple[str, str | None]] = {
    "state": ("i8", None),
    "point": (f"S{NAME_BYTES}", None),
    "x0": ("f8", "mm"),
    "y0": ("f8", "mm"),
    "z0": ("f8", "mm"),
    "x": ("f8", "mm"),
    "y": ("f8", "mm"),
    "sigma": ("f8", "mm"),
}


@dataclass(frozen=True)
class TrackedPoints:
    """The n tracked points of one load step, with x along the straight beam from the clamp, and y across it.

    Parameters
    ----------
    names
        Names of the points.
    rest_mm, points_mm
        (n, 2) x and y of each point at rest, and in the load step, mm.
    sigma_mm
        (n,) standard deviation of a coordinate of each point, mm.
    depth_mm
        (n,) distance of each point at rest from the plane at mid-depth of the beam, mm; None if all are 0.
    """

    names: tuple[str, ...]
    rest_mm: Array
    points_mm: Array
    sigma_mm: Array
    depth_mm: Array | None = None


@dataclass(frozen=True)
class Load:
    """The loads and measured conditions of one load step. A comparison with ``==`` ignores the temperature.

    Parameters
    ----------
    current_A
        Current of the coil, A; None if only the field is known.
    field_mT
        Field at the magnet, mT.
    tip_force_N
        Force at the tip, N.
    tip_force_angle_deg
        Direction of the tip force, degrees from +x (along the straight beam) toward +y (across); None for gravity's.
    field_sigma_mT
        Standard uncertainty of the measured field, mT; None if not measured.
    temperature_degC
        Measured temperature of the specimen, °C; None if not measured.
    """

    current_A: float | None
    field_mT: float
    tip_force_N: float
    tip_force_angle_deg: float | None = None
    field_sigma_mT: float | None = None
    temperature_degC: float | None = field(default=None, compare=False)


def write_points(
    path: Path,
    header: Header,
    gravity_angle_deg: float,
    loads: Sequence[Load],
    points: Sequence[TrackedPoints],
    gravity: bool = True,
) -> None:
    """Write a dataset of tracked points; an existing file is overwritten.

    Parameters
    ----------
    path
        The file.
    header
        Description of the measurement.
    gravity_angle_deg
        Direction of gravity, degrees from +x (along the straight beam) toward +y (across the beam).
    loads, points
        The loads and the tracked points of each load step.
    gravity
        Whether the simulation of the beam includes its weight.

    Raises
    ------
    InputError
        If the direction of gravity is not finite.
    """
    if not math.isfinite(gravity_angle_deg):
        raise InputError(f"--gravity-angle {gravity_angle_deg:g}: should be an angle in degrees, such as 90")
    with h5py.File(path, "w", libver=WRITTEN_AS) as file:
        entry = write_header(file, header)
        data = group(entry, "data", "NXdata")
        data.attrs["signal"] = "y"
        data.attrs["axes"] = ["x"]
        table = columns(data, POINT_COLUMNS)
        states = write_state_columns(entry, "points")
        entry["states"].attrs["gravity_angle_deg"] = gravity_angle_deg
        entry["states"].attrs["gravity"] = gravity
        entry["states"].attrs["field_angle_deg"] = FIELD_ANGLE_DEG
        for index, (load, tracked) in enumerate(zip(loads, points, strict=True)):
            rows = {
                "state": np.full(len(tracked.names), index),
                "point": [name.encode() for name in tracked.names],
                "x0": tracked.rest_mm[:, 0],
                "y0": tracked.rest_mm[:, 1],
                "z0": np.zeros(len(tracked.names)) if tracked.depth_mm is None else tracked.depth_mm,
                "x": tracked.points_mm[:, 0],
                "y": tracked.points_mm[:, 1],
                "sigma": tracked.sigma_mm,
            }
            for name, column in table.items():
                append(column, rows[name])
            append(states["current"], [float("nan") if load.current_A is None else load.current_A])
            append(states["field"], [load.field_mT])
            append(states["tip_force"], [load.tip_force_N])
            append(states["flags"], [flags_to_text(())])
            append(states["index"], [index])
        write_tip_force_angles(entry["states"], [load.tip_force_angle_deg for load in loads])
        write_measured_columns(entry["states"], loads)
        put_date(entry, "end_time", now())


def read_points(entry: h5py.Group, states: int) -> tuple[TrackedPoints, ...]:
    """Return the tracked points of every load step of a dataset."""
    table = {name: entry["data"][name][()] for name in POINT_COLUMNS if name in entry["data"]}
    depth = table.get("z0", np.zeros(len(table["state"])))
    tracked = []
    for index in range(states):
        rows = table["state"] == index
        tracked.append(
            TrackedPoints(
                tuple(name.decode() for name in table["point"][rows]),
                np.column_stack([table["x0"][rows], table["y0"][rows]]),
                np.column_stack([table["x"][rows], table["y"][rows]]),
                table["sigma"][rows],
                depth[rows],
            )
        )
    return tuple(tracked)
