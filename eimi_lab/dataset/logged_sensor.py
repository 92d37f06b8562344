"""A sensor and its readings, as a dataset stores them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class LoggedSensor:
    """A sensor, as described in a dataset.

    Parameters
    ----------
    name
        Name of the sensor in the rig file.
    model
        Text with which the instrument identifies itself.
    measures
        Measured quantity: "field", "specimen_temperature", "coil_temperature" or "other".
    unit
        Unit of the readings.
    at_magnet
        For a gaussmeter, the field at the magnet divided by the field at the probe.
    uncertainty
        Standard uncertainty of one reading, in the unit of the readings; None if unknown.
    uncertainty_share
        Relative standard uncertainty of a factor common to all readings; None if unknown.
    """

    name: str
    model: str
    measures: str
    unit: str
    at_magnet: float = 1.0
    uncertainty: float | None = None
    uncertainty_share: float | None = None


@dataclass(frozen=True)
class SensorLog:
    """The readings of a sensor, one for each of n frames.

    Parameters
    ----------
    sensor
        The sensor.
    state
        (n,) number of the load step of each frame.
    time_s
        (n,) time of each reading on the clock of the run, s; NaN without a reading.
    value
        (n,) the readings; NaN if the sensor was not read.
    standard_uncertainty
        (n,) standard uncertainty that the sensor reported; NaN if it reported none.
    """

    sensor: LoggedSensor
    state: NDArray[np.int64]
    time_s: NDArray[np.float64]
    value: NDArray[np.float64]
    standard_uncertainty: NDArray[np.float64]

    def by_state(self, states: int) -> NDArray[np.float64]:
        """Return the mean reading in each load step, shape (states,); NaN for a load step without a reading."""
        has_reading = np.isfinite(self.value) & (self.state < states)
        count = np.bincount(self.state[has_reading], minlength=states)
        total = np.bincount(self.state[has_reading], weights=self.value[has_reading], minlength=states)
        return np.asarray(np.divide(total, count, out=np.full(states, np.nan), where=count > 0))
