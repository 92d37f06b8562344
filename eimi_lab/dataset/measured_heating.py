"""Compare the measured temperature of the coil with a thermal model: T = T0 + R h / I0², τ dh/dt = I² − h.

T is the coil temperature, T0 the temperature without heating, I the current, τ the thermal time constant, h (A²) the
heat (0 at the first reading), and R the final temperature rise at the continuous current I0. T0 and R are fitted.
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
"""Smallest range (K) of the measured temperatures for which they are compared with the thermal model."""

SEARCHED = np.geomspace(0.1, 10.0, 201)
"""Time constants for which the thermal model is tried, divided by the time constant in the rig file."""

DIFFERENT = 0.3
"""Largest relative difference of the fitted time constant from the time constant in the rig file that is not reported
to the user."""


@dataclass(frozen=True)
class MeasuredHeating:
    """The comparison of measured coil temperatures with the thermal model of the coil.

    Parameters
    ----------
    sensor : str
        Name of the thermometer.
    lowest_degC, highest_degC : float
        The lowest and the highest reading, °C.
    continuous_rise_K : float
        Fitted temperature rise at the continuous current, K.
    rms_K : float
        Root mean square difference between readings and model, K.
    time_constant_s, best_time_constant_s : float
        Thermal time constant in the rig file, and the best fitting one, s.
    best_rms_K : float
        Root mean square difference with ``best_time_constant_s``, K.
    continuous_current_A : float
        The continuous current in the rig file, A.
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
        """Whether the readings contradict the thermal time constant in the rig file."""
        far = abs(self.best_time_constant_s / self.time_constant_s - 1) > DIFFERENT
        return far and self.best_rms_K < 0.7 * self.rms_K

    @property
    def in_words(self) -> str:
        """The measured temperatures, and whether the thermal model of the coil agrees, as text."""
        words = (
            f"{self.lowest_degC:.1f} to {self.highest_degC:.1f} °C ({self.sensor}); the thermal model of the coil "
            f"agrees within {self.rms_K:.2g} K (root mean square) and gives a rise of {self.continuous_rise_K:.3g} K "
            f"at continuous_current_A = {self.continuous_current_A:g}"
        )
        if not self.contradicts:
            return words
        speed = "faster" if self.best_time_constant_s < self.time_constant_s else "slower"
        return (
            f"{words}; the coil warms {speed} than the rig file says: thermal_time_constant_s = "
            f"{self.best_time_constant_s:.3g} would agree within {self.best_rms_K:.2g} K, but the rig file has "
            f"{self.time_constant_s:g}"
        )


def measured_heating(
    log: SensorLog, current_A: ArrayLike, continuous_current_A: float, time_constant_s: float
) -> MeasuredHeating | None:
    """Compare the readings of a thermometer at the coil with the thermal model of the coil.

    Parameters
    ----------
    log : SensorLog
        The readings, °C.
    current_A : array_like, shape (K,)
        Current in each of K load steps, A.
    continuous_current_A, time_constant_s : float
        Continuous current (A) and thermal time constant (s) of the coil.

    Returns
    -------
    MeasuredHeating or None
        The comparison; None for too few or too similar readings.
    """
    order = np.argsort(log.time_s, kind="stable")
    finite = order[np.isfinite(log.value[order]) & np.isfinite(log.time_s[order])]
    time_s, degC, state = log.time_s[finite], log.value[finite], log.state[finite]
    if len(degC) < LEAST_READINGS or np.ptp(degC) < LEAST_RISE_K:
        return None
    squares = (np.asarray(current_A, dtype=float)[state] / continuous_current_A) ** 2
    constants_s = time_constant_s * np.append(SEARCHED, 1.0)
    shares = _heats(time_s, squares, constants_s)
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


def _heats(
    time_s: NDArray[np.float64], squares: NDArray[np.float64], constants_s: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the heat h of the coil at n readings for m time constants τ, shape (m, n): τ dh/dt = q − h.

    h is 0 at the first reading. q (`squares`, shape (n,)) is the squared current over the squared continuous current.
    """
    decay = np.exp(-np.diff(time_s) / constants_s[:, None])
    shares = np.zeros((len(constants_s), len(time_s)))
    for place in range(1, len(time_s)):
        shares[:, place] = squares[place] + (shares[:, place - 1] - squares[place]) * decay[:, place - 1]
    return shares


def coil_heating(dataset: Dataset) -> MeasuredHeating | None:
    """Compare the measured coil temperatures of a dataset with the thermal model of the coil in the rig file.

    Returns None if the model or the readings are missing, or if the readings are too few or too similar.
    """
    text = dataset.text("rig")
    rating = parse_table(text, "rig").get("coil") if text else None
    if not rating:
        return None
    for log in dataset.sensors():
        if log.sensor.measures == "coil_temperature":
            currents = [state.current_A or 0.0 for state in dataset.states]
            return measured_heating(log, currents, rating["continuous_current_A"], rating["thermal_time_constant_s"])
    return None
