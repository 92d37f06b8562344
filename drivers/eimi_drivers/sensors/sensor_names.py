"""Open a sensor by the name of its driver."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any

from eimi_drivers.clock import WallClock
from eimi_drivers.contract import check_sensor, check_sensor_driver
from eimi_drivers.installed import Drivers
from eimi_drivers.interfaces import Clock, InstrumentError, Sensor, SensorDriver, raised
from eimi_drivers.sensors.foreign import ForeignSensor
from eimi_drivers.sensors.fw_bell import FWBell5080
from eimi_drivers.sensors.lake_shore import LakeShore425, LakeShore475
from eimi_drivers.sensors.text_line import TextLine
from eimi_drivers.supplies.logged import LoggedTransport, is_logged

_OWN = (LakeShore425, LakeShore475, FWBell5080, TextLine)

SENSORS: Drivers[SensorDriver] = Drivers("sensor", "eimi_drivers.sensors", {driver.name: driver for driver in _OWN})
"""Sensor drivers by name: drivers of this package, of other installed packages, and drivers added by a program."""


def open_sensor(driver: str, address: str, clock: Clock | None = None) -> Sensor:
    """Open the sensor at an address and return it. No message is sent.

    Parameters
    ----------
    driver : str
        Name of the driver, such as "lakeshore-425".
    address : str
        Serial port or VISA resource.
    clock : Clock, optional
        Clock for all waits; real time by default.

    Raises
    ------
    UnusableDriver
        The driver is unknown or lacks a member.
    InstrumentDisconnected
        The address cannot be opened.
    InstrumentError
        The driver of another package raised an error.
    """
    return open_with(SENSORS[driver], driver, address, clock or WallClock())


def open_with(driver: SensorDriver, name: str, address: str, clock: Clock) -> Sensor:
    """Open a sensor with a driver that is given as an object, and return the sensor. No message is sent.

    Parameters
    ----------
    driver : SensorDriver
        Class or function that opens the sensor.
    name : str
        Name of the driver, for messages.
    address : str
        Serial port or VISA resource.
    clock : Clock
        Clock for all waits: real or simulated time.

    Raises
    ------
    UnusableDriver
        The driver or the sensor lacks a member.
    InstrumentDisconnected
        The address cannot be opened.
    InstrumentError
        The driver raised another error.
    """
    check_sensor_driver(name, driver)
    connect = getattr(driver, "connect", None)
    with ExitStack() as opened:
        try:
            link: Any = address
            if connect is not None:
                link = connect(address)
                if is_logged():
                    link = LoggedTransport(link, clock)
                opened.callback(link.close)
            sensor = driver(link, clock)
        except InstrumentError:
            raise
        except Exception as error:
            raise InstrumentError(f"{name} sensor {address}: its driver raised {raised(error)} on opening") from error
        check_sensor(name, driver, sensor)
        opened.pop_all()
    return sensor if driver in _OWN else ForeignSensor(sensor, name, address)
