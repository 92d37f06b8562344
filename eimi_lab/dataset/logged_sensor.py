"""A sensor and its values, as a dataset stores them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class LoggedSensor:
    """The description of a sensor in a dataset.

    Parameters
    ----------
    name
        Name in the rig file.
    model
        Identification text of the instrument.
    measures
        Quantity in the rig file, such as "field".
    unit
        Unit of the values.
    at_magnet
        Field at the magnet divided by the field at the probe.
    uncertainty, uncertainty_share
        Standard uncertainty of a reading, and the relative standard uncertainty that all readings share, as the rig
        file states them.
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
    """The values of a sensor.

    Parameters
    ----------
    sensor
        The sensor.
    state
        (n,) the state of each frame.
    time_s, value, standard_uncertainty
        (n,) time on the run's clock, value, and the standard uncertainty that the sensor stated; NaN if the sensor
        stated none.
    """

    sensor: LoggedSensor
    state: NDArray[np.int64]
    time_s: NDArray[np.float64]
    value: NDArray[np.float64]
    standard_uncertainty: NDArray[np.float64]

    def by_state(self, states: int) -> NDArray[np.float64]:
        """Return the mean value of each state, (states,); NaN for a state without a value."""
        known = np.isfinite(self.value) & (self.state < states)
        count = np.bincount(self.state[known], minlength=states)
        total = np.bincount(self.state[known], weights=self.value[known], minlength=states)
        return np.asarray(np.divide(total, count, out=np.full(states, np.nan), where=count > 0))
