"""Read the sensors of a bench during a run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from eimi_drivers.interfaces import Clock, Identity, InstrumentError, PowerSupply, Sensor, SensorReading
from eimi_drivers.sensors.coil_thermometer import CoilThermometer
from eimi_lab.acquisition.coil import Coil, never
from eimi_lab.config.sensor import UNITS, RigSensor
from eimi_lab.dataset.logged_sensor import LoggedSensor

TRIED_AGAIN_AFTER_S = 2.0
"""A sensor that gave no value is read again after this time, so that it does not slow down a run."""


def _ignore(message: str) -> None:
    """Do nothing: the `warn` of a caller that needs no warnings."""


@dataclass(frozen=True)
class OpenSensor:
    """An open sensor and its table in the rig file."""

    rule: RigSensor
    sensor: Sensor


def coil_thermometer(rule: RigSensor, supply: PowerSupply, clock: Clock) -> CoilThermometer:
    """Return the sensor that uses the coil as a thermometer, through the readings of its supply."""
    assert rule.at_rest_degC is not None  # the model of the rig file requires both
    assert rule.at_rest_A is not None
    return CoilThermometer(supply.measure, clock, rule.at_rest_degC, rule.at_rest_A)


class Sensing:
    """Read all sensors of a bench. A sensor that fails is left out, with one warning, until it answers again.

    Parameters
    ----------
    sensors : sequence of OpenSensor
        The sensors.
    clock : Clock
        Clock of the run.
    warn : callable
        Receives a warning for the user.
    beat : callable
        Called before each sensor, because several silent sensors take long.
    """

    def __init__(
        self,
        sensors: Sequence[OpenSensor],
        clock: Clock,
        warn: Callable[[str], None] = _ignore,
        beat: Callable[[], None] = never,
    ) -> None:
        self._sensors, self._clock, self._warn, self._beat = tuple(sensors), clock, warn, beat
        self._silent_until_s: dict[str, float] = {}

    def begin(self) -> tuple[tuple[Identity, ...], tuple[LoggedSensor, ...]]:
        """Identify and read every sensor before a run.

        Returns
        -------
        identities, logged
            The identity of each sensor, and its description for the dataset.

        Raises
        ------
        InstrumentError
            If a sensor does not answer, or answers in another unit than its quantity needs.
        """
        identities, logged = [], []
        for each in self._sensors:
            rule, identity = each.rule, each.sensor.identify()
            unit = each.sensor.read().unit
            if unit != UNITS.get(rule.measures, unit):
                raise InstrumentError(
                    f"{identity.address}: the sensor {rule.name} reads in {unit}, but measures = {rule.measures!r} "
                    f"needs {UNITS[rule.measures]}"
                )
            identities.append(identity)
            logged.append(
                LoggedSensor(
                    rule.name,
                    identity.text,
                    rule.measures,
                    unit,
                    rule.at_magnet,
                    rule.uncertainty,
                    rule.uncertainty_share,
                )
            )
        return tuple(identities), tuple(logged)

    def measure_at_rest(self, coil: Coil, stop_if_asked: Callable[[], None]) -> None:
        """Measure the coil's resistance at rest if a sensor is the coil; the output is on without a current.

        Raises InstrumentError, Stopped.
        """
        for each in self._sensors:
            if isinstance(each.sensor, CoilThermometer):
                coil.ramp_to(each.sensor.at_rest_A, stop_if_asked)
                coil.wait_until_reached(stop_if_asked)
                each.sensor.measure_at_rest(stop_if_asked)
                coil.ramp_to(0.0, stop_if_asked)

    def values(self) -> dict[str, float]:
        """Return a new value of every sensor that answers, by name."""
        return {name: reading.value for name, reading in self.read().items()}

    def read(self) -> dict[str, SensorReading]:
        """Return a new reading of every sensor that answers, by name."""
        readings = {}
        for each in self._sensors:
            name = each.rule.name
            if self._clock.now() < self._silent_until_s.get(name, -float("inf")):
                continue
            self._beat()
            try:
                readings[name] = each.sensor.read()
            except InstrumentError as error:
                if name not in self._silent_until_s:
                    self._warn(f"the sensor {name} gives no value: {error}")
                self._silent_until_s[name] = self._clock.now() + TRIED_AGAIN_AFTER_S
            else:
                self._silent_until_s.pop(name, None)
        return readings
