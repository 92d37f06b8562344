"""The sensors of the virtual rig: the drivers of real sensors, connected to emulated sensors, in simulated time."""

from __future__ import annotations

from collections.abc import Callable

from eimi_drivers.emulators.sensors import EmulatedQuantity, emulate_sensor
from eimi_drivers.interfaces import Clock, Sensor
from eimi_drivers.sensors.sensor_names import SENSORS
from eimi_drivers.supplies.transport import InProcessTransport, Responder
from eimi_lab.config.sensor import UNITS, RigSensor

ROOM_DEGC = 23.0
"""Temperature of the virtual laboratory, °C. The virtual coil does not warm up."""

NOISE = {"mT": 0.005, "degC": 0.02}
"""Standard deviation of the noise of a reading, by the unit of the reading and in this unit."""


def open_virtual_sensor(rule: RigSensor, field_mT: Callable[[], float], clock: Clock) -> Sensor:
    """Connect the driver of a real sensor to an emulated sensor in this process, and return the driver.

    Parameters
    ----------
    rule
        The entry of the sensor in the rig file.
    field_mT
        Returns the true field at the magnet along the axis of the coil, mT.
    clock
        The simulated clock.
    """
    instrument = emulated_instrument(rule, field_mT, clock)
    return SENSORS[rule.driver](InProcessTransport(instrument, clock, f"emulated {rule.driver}"), clock)


def emulated_instrument(rule: RigSensor, field_mT: Callable[[], float], clock: Clock) -> Responder:
    """Return an emulated sensor, which measures the field or the temperature of the room.

    Parameters
    ----------
    rule
        The entry of the sensor in the rig file.
    field_mT
        Returns the true field at the magnet along the axis of the coil, mT.
    clock
        The clock of the sensor.

    Raises
    ------
    InstrumentError
        The driver has no emulator.
    """
    unit = UNITS.get(rule.measures, "degC")

    def true() -> float:
        return field_mT() / rule.at_magnet if unit == "mT" else ROOM_DEGC

    return emulate_sensor(rule.driver, EmulatedQuantity(clock, true, unit, NOISE[unit]))
