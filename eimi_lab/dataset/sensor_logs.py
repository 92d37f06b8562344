"""The values of sensors in a dataset: an NXsensor for each sensor, with one row for each frame.

They are in entry/sample/environment (NXenvironment), see
https://manual.nexusformat.org/classes/base_classes/NXsensor.html.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import h5py

from eimi_drivers.interfaces import SensorReading
from eimi_lab.dataset.layout import columns, get_text, group, put_text
from eimi_lab.dataset.logged_sensor import LoggedSensor, SensorLog

PLACE = "sample/environment"
"""The group of the sensors in the entry."""

MEASUREMENTS = {"field": "magnetic_field", "specimen_temperature": "temperature", "coil_temperature": "temperature"}
"""The word of NXsensor for a quantity of the rig file."""

LOG_COLUMNS = ("time", "value", "value_errors")
"""Time on the run's clock (s), value and standard uncertainty; NaN where the sensor gave none."""


def rows_of(name: str, sensed: Sequence[Mapping[str, SensorReading]], frames: int) -> dict[str, list[float]]:
    """Return the rows of a sensor for the frames of a state, by column.

    Parameters
    ----------
    name
        The sensor.
    sensed
        The readings of all sensors with each frame, with times on the run's clock; empty if no sensor was read.
    frames
        Number of frames.
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
    """Return the columns of a sensor's log."""
    return {column: entry[PLACE][name]["value_log"][column] for column in LOG_COLUMNS}


def sensor_names(entry: h5py.Group) -> tuple[str, ...]:
    """Return the names of the sensors whose values a dataset has."""
    place = entry.get(PLACE, {})
    return tuple(sorted(name for name in place if isinstance(place[name], h5py.Group) and "value_log" in place[name]))


def make_sensor_logs(entry: h5py.Group, sensors: Sequence[LoggedSensor]) -> None:
    """Create the empty logs of the sensors of a run; create nothing if the run has no sensors."""
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
        stated = group(place, "stated", "NXcollection")
        put_text(stated, "unit", sensor.unit)
        stated["at_magnet"] = sensor.at_magnet
        stated["uncertainty"] = math.nan if sensor.uncertainty is None else sensor.uncertainty
        stated["uncertainty_share"] = math.nan if sensor.uncertainty_share is None else sensor.uncertainty_share
        log = group(place, "value_log", "NXlog")
        columns(log, {"time": ("f8", "s"), "value": ("f8", sensor.unit), "value_errors": ("f8", sensor.unit)})


def read_sensor_logs(entry: h5py.Group, states: int) -> tuple[SensorLog, ...]:
    """Read the logs of all sensors; rows of a state that was not stored completely are left out."""
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
