"""Fit a straight line to the readings of a gaussmeter: the field as a function of the coil current."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from eimi_lab.dataset.logged_sensor import LoggedSensor, SensorLog


@dataclass(frozen=True)
class FieldLine:
    """The straight line B = slope · I + offset of the field B at the magnet (along the coil axis) and the current I.

    Parameters
    ----------
    probe
        Name and identification of the gaussmeter.
    mT_per_A, offset_mT
        The slope, mT/A, and the offset, mT.
    mT_per_A_sigma, offset_mT_sigma
        Standard uncertainties of the slope (mT/A) and of the offset (mT).
    scatter_mT
        Standard deviation of the readings from the line, mT.
    currents
        Number of different currents in the fit.
    shared_is_stated
        Whether the rig file gives the relative uncertainty common to all readings.
    """

    probe: str
    mT_per_A: float
    mT_per_A_sigma: float
    offset_mT: float
    offset_mT_sigma: float
    scatter_mT: float
    currents: int
    shared_is_stated: bool

    @property
    def in_words(self) -> str:
        """The field for each ampere and without a current, with standard uncertainties, as text."""
        return (
            f"{self.mT_per_A:.5g} ± {self.mT_per_A_sigma:.2g} mT/A, and {self.offset_mT:.3g} ± "
            f"{self.offset_mT_sigma:.2g} mT without a current"
        )


def field_line(
    sensor: LoggedSensor, current_A: ArrayLike, field_mT: ArrayLike, stated_mT: ArrayLike = np.nan
) -> FieldLine | None:
    """Fit the straight line B = slope · I + offset to gaussmeter readings by least squares.

    I is the coil current, and B the field at the magnet: the reading times ``sensor.at_magnet``. Let u be the standard
    uncertainty of one reading. The variance of the slope is the sum of the variances due to the scatter of the readings
    (at least u) and to the scale of the sensor (``sensor.uncertainty_share``). The variance of the offset is the sum
    of those due to the scatter and to the zero of the sensor (u) (JCGM 100:2008, 5.1.2).

    Parameters
    ----------
    sensor
        The gaussmeter.
    current_A, field_mT
        (n,) current (A) and reading (mT); pairs with a NaN are left out.
    stated_mT
        (n,) or one number: standard uncertainty that the gaussmeter reported (NaN for none). It is used if the rig file
        gives no uncertainty.

    Returns
    -------
    FieldLine or None
        The line; None for fewer than two different currents.
    """
    current, field, reported = np.broadcast_arrays(
        np.asarray(current_A, dtype=float), np.asarray(field_mT, dtype=float), np.asarray(stated_mT, dtype=float)
    )
    complete = np.isfinite(current) & np.isfinite(field)
    current, field, reported = current[complete], sensor.at_magnet * field[complete], reported[complete]
    currents = len(np.unique(current))
    if currents < 2:
        return None
    sigma = sensor.uncertainty if sensor.uncertainty is not None else _root_mean_square(reported[np.isfinite(reported)])
    zero_mT = abs(sensor.at_magnet) * sigma
    columns = np.column_stack([current, np.ones(len(current))])
    (slope, offset), *_ = np.linalg.lstsq(columns, field, rcond=None)
    freedom = len(field) - 2
    scatter = float(np.sqrt(np.sum((field - columns @ [slope, offset]) ** 2) / freedom)) if freedom else 0.0
    variance = max(scatter, zero_mT) ** 2 * np.diag(np.linalg.inv(columns.T @ columns))
    return FieldLine(
        f"{sensor.name} ({sensor.model})",
        float(slope),
        float(np.hypot(np.sqrt(variance[0]), (sensor.uncertainty_share or 0.0) * slope)),
        float(offset),
        float(np.hypot(np.sqrt(variance[1]), zero_mT)),
        scatter,
        currents,
        sensor.uncertainty_share is not None,
    )


def measured_line(logs: Sequence[SensorLog], current_A: ArrayLike) -> FieldLine | None:
    """Fit the straight line B = slope · I + offset to the gaussmeter readings B of a run, I being the coil current.

    Parameters
    ----------
    logs
        The readings of all sensors; the first gaussmeter is used.
    current_A
        (K,) current in each of K load steps, A.

    Returns
    -------
    FieldLine or None
        The line; None without a gaussmeter, or for fewer than two different currents.
    """
    for log in logs:
        if log.sensor.measures == "field":
            currents = np.asarray(current_A, dtype=float)
            return field_line(log.sensor, currents[log.state], log.value, log.standard_uncertainty)
    return None


def _root_mean_square(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
