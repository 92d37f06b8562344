"""Read the sensors of a bench during a run, and leave out sensors that give no value."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from eimi_drivers.interfaces import Clock, Identity, InstrumentError, PowerSupply, Sensor, SensorReading
from eimi_drivers.sensors.coil_thermometer import CoilThermometer
from eimi_lab.acquisition.coil import Coil, never
from eimi_lab.config.sensor import UNITS, RigSensor
from eimi_lab.dataset.logged_sensor import LoggedSensor

TRIED_AGAIN_AFTER_S = 2.0
"""Time (s) after which a sensor that gave no value is read again, so that the sensor does not slow down the run."""


def _ignore(message: str) -> None:
    """Do nothing with a warning."""


@dataclass(frozen=True)
class OpenSensor:
    """An open sensor of a bench, with its table in the rig file."""

    rule: RigSensor
    sensor: Sensor


def coil_thermometer(rule: RigSensor, supply: PowerSupply, clock: Clock) -> CoilThermometer:
    """Return a sensor that measures the temperature of the coil by the resistance of the coil.

    Parameters
    ----------
    rule : RigSensor
        Table of the sensor in the rig file. It gives the temperature (°C) and the current (A) at which the resistance
        of the cold coil is measured.
    supply : PowerSupply
        Measures the voltage and the current of the coil.
    clock : Clock
        Clock of the run.
    """
    assert rule.at_rest_degC is not None  # the rig file of a coil thermometer must give both values
    assert rule.at_rest_A is not None
    return CoilThermometer(supply.measure, clock, rule.at_rest_degC, rule.at_rest_A)


class Sensing:
    """The sensors of a bench, which are read together. The user receives one warning about a sensor that fails.

    Parameters
    ----------
    sensors : sequence of OpenSensor
        The sensors.
    clock : Clock
        Clock of the run.
    warn : callable
        Receives a warning for the user, as text.
    beat : callable
        Called before each sensor is read, to report that the run is alive.
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
        self._units: dict[str, str] = {}

    def begin(self) -> tuple[tuple[Identity, ...], tuple[LoggedSensor, ...]]:
        """Identify every sensor and read it once before a run.

        Returns
        -------
        identities : tuple of Identity
            The identity of each sensor.
        logged : tuple of LoggedSensor
            The description of each sensor for the dataset.

        Raises
        ------
        InstrumentError
            If a sensor does not answer or reads in a wrong unit.
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
            self._units[rule.name] = unit
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
        """Measure the resistance of the cold coil, if a sensor uses the coil as a thermometer.

        Parameters
        ----------
        coil : Coil
            The coil, with the output on and no current. It is ramped to a small current and back to zero.
        stop_if_asked : callable
            Called between the operations; raises an exception if the run has to stop.

        Raises
        ------
        InstrumentError
            If the supply fails or the current is wrong.
        Stopped
            If a signal asked the run to stop.
        """
        for each in self._sensors:
            if isinstance(each.sensor, CoilThermometer):
                coil.ramp_to(each.sensor.at_rest_A, stop_if_asked)
                coil.wait_until_reached(stop_if_asked)
                each.sensor.measure_at_rest(stop_if_asked)
                coil.ramp_to(0.0, stop_if_asked)

    def values(self) -> dict[str, float]:
        """Read all sensors, and return the values by the name of the sensor, in the unit of each sensor.

        A sensor that does not answer is left out.
        """
        return {name: reading.value for name, reading in self.read().items()}

    def read(self) -> dict[str, SensorReading]:
        """Read all sensors, and return the readings (value, uncertainty and time) by the name of the sensor.

        A sensor that does not answer, or reads in another unit than at the beginning of the run, is left out.
        """
        readings = {}
        for each in self._sensors:
            name = each.rule.name
            if self._clock.now() < self._silent_until_s.get(name, -float("inf")):
                continue
            self._beat()
            try:
                readings[name] = self._in_its_unit(each)
            except InstrumentError as error:
                if name not in self._silent_until_s:
                    self._warn(f"the sensor {name} gives no value: {error}")
                self._silent_until_s[name] = self._clock.now() + TRIED_AGAIN_AFTER_S
            else:
                self._silent_until_s.pop(name, None)
        return readings

    def _in_its_unit(self, each: OpenSensor) -> SensorReading:
        reading = each.sensor.read()
        unit = self._units.get(each.rule.name, reading.unit)
        if reading.unit != unit:
            raise InstrumentError(
                f"{each.rule.address}: reads in {reading.unit}, but read in {unit} at the beginning of the run"
            )
        return reading
