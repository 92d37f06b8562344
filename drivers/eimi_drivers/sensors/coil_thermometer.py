"""Use a copper coil as a thermometer: its resistance increases with the temperature."""

from __future__ import annotations

import math
from collections.abc import Callable

from eimi_drivers.interfaces import Clock, Identity, InstrumentError, Reading, SensorReading

COPPER_PER_K = 0.00393
"""Temperature coefficient of the resistance of annealed copper at 20 °C (IEC 60028)."""

COEFFICIENT_AT_DEGC = 20.0

STEP_V, STEP_A = 0.01, 0.001
"""Assumed resolution of the measured voltage (V) and current (A).

A Korad supply has this resolution. Most other supplies have a finer resolution.
"""

READINGS_AT_REST = 10
BETWEEN_READINGS_S = 0.2

LEAST_SHARE = 0.2
"""Smallest current with which the resistance is measured, divided by `CoilThermometer.at_rest_A`."""


class CoilThermometer:
    """Sensor for the mean temperature of a copper coil, from the voltage and current that the supply measures.

    The temperature is T = 20 °C + ((R / R₀) (1 + α (T₀ - 20 °C)) - 1) / α. R is the resistance (voltage / current), R₀
    the resistance at the known temperature T₀ before the run, and α = `COPPER_PER_K` the temperature coefficient of
    copper at 20 °C.

    Parameters
    ----------
    measure : callable
        Returns the measured output of the supply, a `Reading`.
    clock : Clock
        Clock for all waits: real or simulated time.
    at_rest_degC : float
        Temperature T₀ of the coil before the run, °C.
    at_rest_A : float
        Current with which R₀ is measured, A.
    """

    name: str = "coil-resistance"
    timeout_s: float = 2.0

    def __init__(self, measure: Callable[[], Reading], clock: Clock, at_rest_degC: float, at_rest_A: float) -> None:
        self._measure, self._clock = measure, clock
        self.at_rest_degC, self.at_rest_A = at_rest_degC, at_rest_A
        self._at_rest_ohm: float | None = None
        self._share_at_rest = self._scatter = 0.0
        self._last = SensorReading(at_rest_degC, "degC", clock.now())

    def identify(self) -> Identity:
        """Return an identity that describes the coil."""
        return Identity(self.name, f"copper coil, {self.at_rest_degC:g} °C at rest", "supply")

    def measure_at_rest(self, between_readings: Callable[[], None]) -> None:
        """Measure the resistance of the coil before the run, as the mean of `READINGS_AT_REST` measurements.

        Parameters
        ----------
        between_readings : callable
            Function that is called before each measurement; it may raise an error.

        Raises
        ------
        InstrumentError
            The measured voltage or current is zero, or their signs differ.
        """
        readings = []
        for _ in range(READINGS_AT_REST):
            between_readings()
            self._clock.sleep(BETWEEN_READINGS_S)
            readings.append(self._measure())
        resistances = [_resistance_ohm(reading) for reading in readings]
        mean = sum(resistances) / len(resistances)
        variance = sum((resistance - mean) ** 2 for resistance in resistances) / (len(resistances) - 1)
        self._at_rest_ohm, self._scatter = mean, math.sqrt(variance) / mean
        self._share_at_rest = math.hypot(self._scatter / math.sqrt(READINGS_AT_REST), _digits_share(readings[-1]))

    def read(self) -> SensorReading:
        """Return the temperature of the coil (°C); the last temperature if the current is too small."""
        reading = self._measure()
        if self._at_rest_ohm is None or abs(reading.current_A) < LEAST_SHARE * self.at_rest_A:
            return self._last
        ratio = _resistance_ohm(reading) / self._at_rest_ohm
        scale = (1 + COPPER_PER_K * (self.at_rest_degC - COEFFICIENT_AT_DEGC)) / COPPER_PER_K
        sigma = ratio * scale * math.hypot(self._scatter, _digits_share(reading), self._share_at_rest)
        degC = COEFFICIENT_AT_DEGC + ratio * scale - 1 / COPPER_PER_K
        self._last = SensorReading(degC, "degC", self._clock.now(), sigma)
        return self._last

    def close(self) -> None:
        """Do nothing; the supply stays open."""


def _digits_share(reading: Reading) -> float:
    """Return the relative standard uncertainty of voltage / current that results from their rounding.

    A value that is rounded to steps of the size d has the standard uncertainty d / √12 (JCGM 100:2008, F.2.2.1).
    """
    return math.hypot(STEP_V / reading.voltage_V, STEP_A / reading.current_A) / math.sqrt(12.0)


def _resistance_ohm(reading: Reading) -> float:
    if not reading.current_A or reading.voltage_V / reading.current_A <= 0:
        raise InstrumentError(
            f"supply: the measured {reading.voltage_V:g} V and {reading.current_A:g} A give no positive resistance of "
            "the coil; measure the temperature of the coil with another sensor"
        )
    return reading.voltage_V / reading.current_A
