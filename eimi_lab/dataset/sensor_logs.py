"""Store and read the readings of sensors in a dataset.

The group entry/sample/environment has an NXsensor for each sensor, with one row for each frame
(https://manual.nexusformat.org/classes/base_classes/NXsensor.html).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import h5py

from eimi_drivers.interfaces import SensorReading
from eimi_lab.dataset.layout import columns, get_text, group, put_text
from eimi_lab.dataset.logged_sensor import LoggedSensor, SensorLog

PLACE = "sample/environment"
"""Path of the group of all sensors, inside the group `entry`."""

MEASUREMENTS = {"field": "magnetic_field", "specimen_temperature": "temperature", "coil_temperature": "temperature"}
"""For each quantity in the rig file, the word that NXsensor defines for it."""

LOG_COLUMNS = ("time", "value", "value_errors")
"""Columns of a log: time on the clock of the run (s), reading and standard uncertainty; NaN for an unknown value."""


def rows_of(name: str, sensed: Sequence[Mapping[str, SensorReading]], frames: int) -> dict[str, list[float]]:
    """Return the rows that one load step adds to the log of a sensor: one value for each frame, by column.

    Parameters
    ----------
    name
        Name of the sensor.
    sensed
        For each frame, the readings of all sensors by name; empty if no sensor was read.
    frames
        Number of frames of the load step.
    """
    rows: dict[str, list[float]] = {column: [] for column in LOG_COLUMNS}
    for readings in sensed or [{}] * frames:
        reading = readings.get(name)
        sigma = reading.standard_uncertainty if reading else None
        rows["time"].append(reading.time_s if reading else math.nan)
        rows["value"].append(reading.value if reading else math.nan)
        rows["value_errors"].append(math.nan if sigma is None else sigma)
    return rows


def log_of(entry: h5py.Group, name: str) -> dict[str, h5py.Dataset]:
    """Return the columns in the file that contain the readings of the sensor ``name``, by the name of the column."""
    return {column: entry[PLACE][name]["value_log"][column] for column in LOG_COLUMNS}


def sensor_names(entry: h5py.Group) -> tuple[str, ...]:
    """Return the names of the sensors that have a log in a dataset, in alphabetical order."""
    place = entry.get(PLACE, {})
    return tuple(sorted(name for name in place if isinstance(place[name], h5py.Group) and "value_log" in place[name]))


def make_sensor_logs(entry: h5py.Group, sensors: Sequence[LoggedSensor]) -> None:
    """Create an empty log for each sensor of a run in a new dataset."""
    if not sensors:
        return
    environment = group(entry["sample"], "environment", "NXenvironment")
    put_text(environment, "name", "sensors of the bench")
    for sensor in sensors:
        place = group(environment, sensor.name, "NXsensor")
        put_text(place, "name", sensor.name)
        put_text(place, "model", sensor.model)
        put_text(place, "short_name", sensor.measures)
        if sensor.measures in MEASUREMENTS:
            put_text(place, "measurement", MEASUREMENTS[sensor.measures])
        from_rig_file = group(place, "stated", "NXcollection")
        put_text(from_rig_file, "unit", sensor.unit)
        from_rig_file["at_magnet"] = sensor.at_magnet
        from_rig_file["uncertainty"] = math.nan if sensor.uncertainty is None else sensor.uncertainty
        from_rig_file["uncertainty_share"] = math.nan if sensor.uncertainty_share is None else sensor.uncertainty_share
        log = group(place, "value_log", "NXlog")
        columns(log, {"time": ("f8", "s"), "value": ("f8", sensor.unit), "value_errors": ("f8", sensor.unit)})


def read_sensor_logs(entry: h5py.Group, states: int) -> tuple[SensorLog, ...]:
    """Return the readings of all sensors in the first ``states`` load steps; empty if the run had no sensors."""
    logs = []
    for name in sensor_names(entry):
        place = entry[PLACE][name]
        stored_columns = {column: data[()] for column, data in log_of(entry, name).items()}
        rows = min(len(entry["data/state"]), *map(len, stored_columns.values()))
        of_state = entry["data/state"][:rows]
        stored = of_state < states
        logs.append(
            SensorLog(
                LoggedSensor(
                    name,
                    get_text(place, "model"),
                    get_text(place, "short_name"),
                    get_text(place["stated"], "unit"),
                    float(place["stated/at_magnet"][()]),
                    _none_if_nan(place["stated/uncertainty"][()]),
                    _none_if_nan(place["stated/uncertainty_share"][()]),
                ),
                of_state[stored],
                *(stored_columns[column][:rows][stored] for column in LOG_COLUMNS),
            )
        )
    return tuple(logs)


def _none_if_nan(value: float) -> float | None:
    return None if math.isnan(value) else float(value)
