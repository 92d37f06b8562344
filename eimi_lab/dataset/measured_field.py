"""Fit a straight line, field against coil current, to the readings of a gaussmeter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from eimi_lab.dataset.logged_sensor import LoggedSensor, SensorLog


@dataclass(frozen=True)
class FieldLine:
    """The field at the magnet along the coil's axis as a straight line: slope times current plus offset.

    Parameters
    ----------
    probe
        Name and identification of the gaussmeter; datasets with the same probe share the error of its calibration.
    mT_per_A, offset_mT
        The slope and the offset. The offset is the sum of the probe's zero error, remanence and the background field.
    mT_per_A_sigma, offset_mT_sigma
        Standard uncertainties of slope and offset.
    scatter_mT
        Standard deviation of the readings about the line.
    currents
        Number of different currents.
    shared_is_stated
        Whether an uncertainty that all readings share was stated. Otherwise the scale of the gaussmeter is exact.
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
        """Return slope and offset with their standard uncertainties, in words."""
        return (
            f"{self.mT_per_A:.5g} ± {self.mT_per_A_sigma:.2g} mT/A, and {self.offset_mT:.3g} ± "
            f"{self.offset_mT_sigma:.2g} mT without a current"
        )


def field_line(
    sensor: LoggedSensor, current_A: ArrayLike, field_mT: ArrayLike, stated_mT: ArrayLike = np.nan
) -> FieldLine | None:
    """Fit a straight line to the readings of a gaussmeter by least squares.

    The standard deviation of one reading is the larger of the scatter about the line and the stated uncertainty. The
    stated uncertainty also applies to the zero of the gaussmeter, which all readings share, and is added to the
    uncertainty of the offset. The relative uncertainty that all readings share is added to the uncertainty of the slope
    (JCGM 100:2008, 5.1.2).

    Parameters
    ----------
    sensor
        The gaussmeter.
    current_A, field_mT
        (n,) currents and readings; a reading that is NaN is left out.
    stated_mT
        (n,) or a number: the standard uncertainty that the gaussmeter stated for each reading; NaN if the gaussmeter
        stated none. An uncertainty stated in the rig file takes precedence.

    Returns
    -------
    FieldLine or None
        None if there are readings at fewer than two different currents.
    """
    current, field, stated = np.broadcast_arrays(
        np.asarray(current_A, dtype=float), np.asarray(field_mT, dtype=float), np.asarray(stated_mT, dtype=float)
    )
    known = np.isfinite(current) & np.isfinite(field)
    current, field, stated = current[known], sensor.at_magnet * field[known], stated[known]
    currents = len(np.unique(current))
    if currents < 2:
        return None
    sigma = sensor.uncertainty if sensor.uncertainty is not None else _root_mean_square(stated[np.isfinite(stated)])
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
    """Fit a straight line, field against current, to the gaussmeter readings of a run.

    Parameters
    ----------
    logs
        The values of all sensors.
    current_A
        (states,) the current of each state.

    Returns
    -------
    FieldLine or None
        None if the run has no gaussmeter, or readings at fewer than two different currents.
    """
    for log in logs:
        if log.sensor.measures == "field":
            currents = np.asarray(current_A, dtype=float)
            return field_line(log.sensor, currents[log.state], log.value, log.standard_uncertainty)
    return None


def _root_mean_square(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
