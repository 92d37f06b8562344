"""The sensors of the virtual rig: ordinary drivers with emulated instruments, in simulated time."""

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
"""Standard deviation of a reading, by its unit."""


def open_virtual_sensor(rule: RigSensor, field_mT: Callable[[], float], clock: Clock) -> Sensor:
    """Open the ordinary driver of a sensor on an emulated instrument.

    Parameters
    ----------
    rule
        The sensor in the rig file.
    field_mT
        Returns the true field at the magnet along the axis of the coil, mT.
    clock
        The simulated clock.

    Returns
    -------
    Sensor
        The open driver.
    """
    instrument = emulated_instrument(rule, field_mT, clock)
    return SENSORS[rule.driver](InProcessTransport(instrument, clock, f"emulated {rule.driver}"), clock)


def emulated_instrument(rule: RigSensor, field_mT: Callable[[], float], clock: Clock) -> Responder:
    """Return the emulated instrument of a sensor. The parameters are those of `open_virtual_sensor`.

    The instrument shows the field if the sensor measures a field, otherwise the temperature of the room. Raises
    InstrumentError if the driver has no emulator.
    """
    unit = UNITS.get(rule.measures, "degC")

    def true() -> float:
        return field_mT() / rule.at_magnet if unit == "mT" else ROOM_DEGC

    return emulate_sensor(rule.driver, EmulatedQuantity(clock, true, unit, NOISE[unit]))
