"""The coil as a thermometer: the resistance of its copper, voltage over current, grows with the temperature."""

from __future__ import annotations

import math
from collections.abc import Callable

from eimi_drivers.interfaces import Clock, Identity, InstrumentError, Reading, SensorReading

COPPER_PER_K = 0.00393
"""Temperature coefficient of the resistance of annealed copper at 20 °C (IEC 60028)."""

COEFFICIENT_AT_DEGC = 20.0

READINGS_AT_REST = 10
BETWEEN_READINGS_S = 0.2

LEAST_SHARE = 0.2
"""Below this fraction of the current at rest the resistance is too uncertain, and the last temperature is returned."""


class CoilThermometer:
    """Compute the mean temperature of a copper coil from the supply's own readings of voltage and current.

    With R = R₂₀ (1 + α (T - 20 °C)), the temperature is T = 20 °C + ((R / R₀) (1 + α (T₀ - 20 °C)) - 1) / α. The
    resistance at rest R₀ is measured before the run, when the coil is at T₀. The leads are assumed to stay as they are.
    While hardly any current flows, the resistance is not known; the last value with its time is then returned.

    Parameters
    ----------
    measure : callable
        Measures the output of the supply.
    clock : Clock
        The clock of the rig.
    at_rest_degC : float
        The temperature T₀ of the coil before the run, which is that of the room.
    at_rest_A : float
        The current with which the resistance at rest is measured.
    """

    name: str = "coil-resistance"
    timeout_s: float = 2.0

    def __init__(self, measure: Callable[[], Reading], clock: Clock, at_rest_degC: float, at_rest_A: float) -> None:
        self._measure, self._clock = measure, clock
        self.at_rest_degC, self.at_rest_A = at_rest_degC, at_rest_A
        self._at_rest_ohm: float | None = None
        self._share = 0.0
        self._last = SensorReading(at_rest_degC, "degC", clock.now())

    def identify(self) -> Identity:
        """Return what the thermometer is; it has no line of its own."""
        return Identity(self.name, f"copper coil, {self.at_rest_degC:g} °C at rest", "supply")

    def measure_at_rest(self, between_readings: Callable[[], None]) -> None:
        """Measure the resistance at rest; the current `at_rest_A` flows.

        Parameters
        ----------
        between_readings : callable
            Called before each reading, so that the caller can watch the supply; it may raise.

        Raises
        ------
        InstrumentError
            If the supply shows no voltage or no current.
        """
        readings = []
        for _ in range(READINGS_AT_REST):
            between_readings()
            self._clock.sleep(BETWEEN_READINGS_S)
            readings.append(_resistance_ohm(self._measure()))
        mean = sum(readings) / len(readings)
        variance = sum((reading - mean) ** 2 for reading in readings) / (len(readings) - 1)
        self._at_rest_ohm, self._share = mean, math.sqrt(variance) / mean

    def read(self) -> SensorReading:
        """Return the temperature, or the last one while hardly any current flows."""
        reading = self._measure()
        if self._at_rest_ohm is None or abs(reading.current_A) < LEAST_SHARE * self.at_rest_A:
            return self._last
        ratio = _resistance_ohm(reading) / self._at_rest_ohm
        scale = (1 + COPPER_PER_K * (self.at_rest_degC - COEFFICIENT_AT_DEGC)) / COPPER_PER_K
        # One reading scatters as those at rest did, and more at a smaller current, because the digits are fixed.
        spread = self._share * max(1.0, abs(self.at_rest_A / reading.current_A))
        sigma = ratio * scale * math.hypot(spread, self._share / math.sqrt(READINGS_AT_REST))
        degC = COEFFICIENT_AT_DEGC + ratio * scale - 1 / COPPER_PER_K
        self._last = SensorReading(degC, "degC", self._clock.now(), sigma)
        return self._last

    def close(self) -> None:
        """Do nothing: the supply is closed by its own user."""


def _resistance_ohm(reading: Reading) -> float:
    if not reading.current_A or reading.voltage_V / reading.current_A <= 0:
        raise InstrumentError(
            f"supply: {reading.voltage_V:g} V and {reading.current_A:g} A are no resistance of a coil; measure its "
            "temperature with another sensor"
        )
    return reading.voltage_V / reading.current_A
