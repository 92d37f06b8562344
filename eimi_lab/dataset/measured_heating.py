"""Compare the measured temperature of the coil with the model by which a run predicts its heat.

The model is that of `eimi_lab.acquisition.heating`: a body of first order, whose temperature rise is R h / I₀², where τ
dh/dt = I² − h, I₀ is the continuous current and R the rise at this current. The initial temperature and R follow from
the readings by least squares. The coil is assumed to be cold at the first reading. Each current is assumed to begin at
the last reading of the previous state, so that ramps are neglected.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from eimi_lab.config.toml import parse_table
from eimi_lab.dataset.logged_sensor import SensorLog

if TYPE_CHECKING:
    from eimi_lab.dataset.reading import Dataset

LEAST_READINGS = 6
LEAST_RISE_K = 1.0
"""A smaller rise (K) does not test the model."""

SEARCHED = np.geomspace(0.1, 10.0, 201)
"""The time constants that are compared with the stated one, as fractions of the stated one."""

DIFFERENT = 0.3
"""A best time constant that differs by more than this fraction from the stated one is reported, if it fits better."""


@dataclass(frozen=True)
class MeasuredHeating:
    """The measured temperatures of the coil and the model of its heat.

    Parameters
    ----------
    sensor : str
        Name of the thermometer.
    lowest_degC, highest_degC : float
        The range of the readings, °C.
    continuous_rise_K : float
        Temperature rise at the continuous current of the rig, by the model, K.
    rms_K : float
        Root mean square difference of the readings from the model with the stated time constant, K.
    time_constant_s, best_time_constant_s : float
        The stated time constant, and the time constant that fits the readings best, s.
    best_rms_K : float
        Root mean square difference with the best time constant, K.
    continuous_current_A : float
        The continuous current of the rig, A.
    """

    sensor: str
    lowest_degC: float
    highest_degC: float
    continuous_rise_K: float
    rms_K: float
    time_constant_s: float
    best_time_constant_s: float
    best_rms_K: float
    continuous_current_A: float

    @property
    def contradicts(self) -> bool:
        """Return whether another time constant than the stated one fits the readings clearly better."""
        far = abs(self.best_time_constant_s / self.time_constant_s - 1) > DIFFERENT
        return far and self.best_rms_K < 0.7 * self.rms_K

    @property
    def in_words(self) -> str:
        """Return the measurement and the comparison in one sentence."""
        words = (
            f"{self.lowest_degC:.1f} to {self.highest_degC:.1f} °C ({self.sensor}); the model of the coil's heat "
            f"follows within {self.rms_K:.2g} K (root mean square) and gives a rise of {self.continuous_rise_K:.3g} K "
            f"at continuous_current_A = {self.continuous_current_A:g}"
        )
        if not self.contradicts:
            return words
        speed = "faster" if self.best_time_constant_s < self.time_constant_s else "slower"
        return (
            f"{words}; the coil warms {speed} than stated: thermal_time_constant_s = {self.best_time_constant_s:.3g} "
            f"fits within {self.best_rms_K:.2g} K, {self.time_constant_s:g} is stated"
        )


def measured_heating(
    log: SensorLog, current_A: ArrayLike, continuous_current_A: float, time_constant_s: float
) -> MeasuredHeating | None:
    """Compare the readings of a thermometer at the coil with the model.

    Parameters
    ----------
    log : SensorLog
        The readings, °C.
    current_A : array_like, shape (states,)
        The current of each state, A.
    continuous_current_A, time_constant_s : float
        The thermal rating of the coil.

    Returns
    -------
    MeasuredHeating or None
        None if there are too few readings, or if the temperature hardly changed.
    """
    order = np.argsort(log.time_s, kind="stable")
    known = order[np.isfinite(log.value[order]) & np.isfinite(log.time_s[order])]
    time_s, degC, state = log.time_s[known], log.value[known], log.state[known]
    if len(degC) < LEAST_READINGS or np.ptp(degC) < LEAST_RISE_K:
        return None
    squares = (np.asarray(current_A, dtype=float)[state] / continuous_current_A) ** 2
    constants_s = time_constant_s * np.append(SEARCHED, 1.0)
    shares = _shares(time_s, squares, constants_s)
    fits = [np.polyfit(share, degC, 1) if np.ptp(share) > 0 else np.array([0.0, degC.mean()]) for share in shares]
    rms_K = np.array(
        [np.sqrt(np.mean((degC - np.polyval(fit, share)) ** 2)) for fit, share in zip(fits, shares, strict=True)]
    )
    best = int(np.argmin(rms_K))
    return MeasuredHeating(
        log.sensor.name,
        float(degC.min()),
        float(degC.max()),
        float(fits[-1][0]),
        float(rms_K[-1]),
        time_constant_s,
        float(constants_s[best]),
        float(rms_K[best]),
        continuous_current_A,
    )


def _shares(
    time_s: NDArray[np.float64], squares: NDArray[np.float64], constants_s: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the heat h / I₀² at each reading for each time constant, (constants, readings).

    Between two readings the current is that of the later one.
    """
    decay = np.exp(-np.diff(time_s) / constants_s[:, None])
    shares = np.zeros((len(constants_s), len(time_s)))
    for place in range(1, len(time_s)):
        shares[:, place] = squares[place] + (shares[:, place - 1] - squares[place]) * decay[:, place - 1]
    return shares


def coil_heating(dataset: Dataset) -> MeasuredHeating | None:
    """Return the comparison for a dataset; None without a thermometer at the coil or without a thermal rating."""
    text = dataset.text("rig")
    rating = parse_table(text, "rig").get("coil") if text else None
    if not rating:
        return None
    for log in dataset.sensors():
        if log.sensor.measures == "coil_temperature":
            currents = [state.current_A or 0.0 for state in dataset.states]
            return measured_heating(log, currents, rating["continuous_current_A"], rating["thermal_time_constant_s"])
    return None
