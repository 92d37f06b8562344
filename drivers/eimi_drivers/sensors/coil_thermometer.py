"""The coil as a thermometer: the resistance of its copper, voltage over current, grows with the temperature."""

from __future__ import annotations

import math
from collections.abc import Callable

from eimi_drivers.interfaces import Clock, Identity, InstrumentError, Reading, SensorReading

COPPER_PER_K = 0.00393
"""Temperature coefficient of the resistance of annealed copper at 20 °C (IEC 60028)."""

COEFFICIENT_AT_DEGC = 20.0

STEP_V, STEP_A = 0.01, 0.001
"""Last digits of voltage and current, which are assumed: a Korad has these, and most other supplies have finer ones."""

READINGS_AT_REST = 10
BETWEEN_READINGS_S = 0.2

LEAST_SHARE = 0.2
"""Below this fraction of the current at rest the resistance is too uncertain, and the last temperature is returned."""


class CoilThermometer:
    """Compute the mean temperature of a copper coil from the supply's own readings of voltage and current.

    With R = R₂₀ (1 + α (T - 20 °C)), the temperature is T = 20 °C + ((R / R₀) (1 + α (T₀ - 20 °C)) - 1) / α. The
    resistance at rest R₀ is measured before the run, when the coil is at T₀. The leads are assumed not to change. While
    hardly any current flows, the resistance cannot be measured; the last value with its time is then returned.

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
        self._share_at_rest = self._scatter = 0.0
        self._last = SensorReading(at_rest_degC, "degC", clock.now())

    def identify(self) -> Identity:
        """Return the identity of the thermometer, which has no line to an instrument."""
        return Identity(self.name, f"copper coil, {self.at_rest_degC:g} °C at rest", "supply")

    def measure_at_rest(self, between_readings: Callable[[], None]) -> None:
        """Measure the resistance of the coil at rest, while the current `at_rest_A` flows.

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
            readings.append(self._measure())
        resistances = [_resistance_ohm(reading) for reading in readings]
        mean = sum(resistances) / len(resistances)
        variance = sum((resistance - mean) ** 2 for resistance in resistances) / (len(resistances) - 1)
        self._at_rest_ohm, self._scatter = mean, math.sqrt(variance) / mean
        self._share_at_rest = math.hypot(self._scatter / math.sqrt(READINGS_AT_REST), _digits_share(readings[-1]))

    def read(self) -> SensorReading:
        """Return the temperature; while hardly any current flows, return the last temperature."""
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
        """Do nothing: the supply is closed by its own user."""


def _digits_share(reading: Reading) -> float:
    """Return the standard uncertainty of a resistance from the last digits, as a fraction (JCGM 100:2008, F.2.2.1)."""
    return math.hypot(STEP_V / reading.voltage_V, STEP_A / reading.current_A) / math.sqrt(12.0)


def _resistance_ohm(reading: Reading) -> float:
    if not reading.current_A or reading.voltage_V / reading.current_A <= 0:
        raise InstrumentError(
            f"supply: {reading.voltage_V:g} V and {reading.current_A:g} A give no positive resistance of the coil; "
            "measure its temperature with another sensor"
        )
    return reading.voltage_V / reading.current_A
