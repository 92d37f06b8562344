"""The table [[sensors]] of a rig file: gaussmeters, thermometers and other sensors that a run reads."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from pydantic import Field, field_validator, model_validator

from eimi_drivers.emulators.sensors import SENSOR_DIALECTS
from eimi_drivers.installed import did_you_mean
from eimi_drivers.sensors.coil_thermometer import CoilThermometer
from eimi_drivers.sensors.sensor_names import SENSORS
from eimi_drivers.supplies.address import check_address
from eimi_lab.config.toml import Table

EMULATED = "virtual"
"""The address of an emulated sensor of the virtual rig."""

SUPPLY = "supply"
"""The address of a coil that serves as thermometer by its resistance."""

Quantity = Literal["field", "specimen_temperature", "coil_temperature", "other"]

UNITS: dict[str, str] = {"field": "mT", "specimen_temperature": "degC", "coil_temperature": "degC"}
"""The required unit of a reading, by the quantity that the sensor measures. Any other quantity may have any unit."""


class RigSensor(Table):
    """A sensor that a run reads with every stored frame, and also every 1.5 s."""

    name: str = Field(pattern=r"^[a-z][a-z0-9_]{0,39}$")
    """Name of the sensor in the dataset and in [[interlocks]]: small letters, digits and underscores."""
    driver: str
    """lakeshore-425, lakeshore-475, fwbell-5080, text-line, coil-resistance, or the name of a driver from another
    package. The driver coil-resistance computes the temperature of the coil from the resistance of the coil, which is
    the measured voltage of the supply divided by the measured current.
    """
    address: str = Field(min_length=1)
    """A serial port or a VISA resource; "virtual" for an emulated sensor of the virtual rig; "supply" for the driver
    coil-resistance.
    """
    measures: Quantity = "other"
    """The measured quantity. field: the field along the axis of the coil, positive for a positive current; a fit uses
    these readings instead of coil_constant_mT_per_A. specimen_temperature or coil_temperature: the temperature of the
    specimen or of the coil. other: the readings are only stored, and can have an interlock.
    """
    at_magnet: float = 1.0
    """Field at the magnet divided by the field at the probe; negative if the probe points in the opposite direction."""
    uncertainty: float | None = Field(default=None, ge=0)
    """Standard uncertainty of one reading, in the unit of the reading; by default the uncertainty that the sensor
    reports.
    """
    uncertainty_share: float | None = Field(default=None, ge=0, le=0.5)
    """Relative standard uncertainty from the calibration of the probe and from at_magnet. The error is the same for all
    readings.
    """

    at_rest_degC: float | None = Field(default=None, gt=-50, lt=100)
    """For the driver coil-resistance: temperature of the coil before the run, which is the room temperature. Before a
    run is resumed, let the coil cool to this temperature.
    """
    at_rest_A: float | None = Field(default=None, gt=0)
    """For the driver coil-resistance: current with which the resistance at this temperature is measured before the
    first state.
    """

    @field_validator("driver")
    @classmethod
    def _exists(cls, driver: str) -> str:
        names = [*SENSORS, CoilThermometer.name]
        if driver not in names:
            raise ValueError(f"is not a driver; the drivers are {', '.join(names)}{did_you_mean(driver, names)}")
        return driver

    @field_validator("address")
    @classmethod
    def _opens_no_file(cls, address: str) -> str:
        check_address(address)
        return address

    @model_validator(mode="after")
    def _consistent(self) -> RigSensor:
        if self.at_magnet == 0 or (self.at_magnet != 1 and self.measures != "field"):
            raise ValueError(
                f"at_magnet = {self.at_magnet:g} should be the field at the magnet divided by the field at the probe, "
                'other than 0, and is only for measures = "field"'
            )
        keys = (self.at_rest_degC, self.at_rest_A)
        if self.is_coil and (None in keys or self.address != SUPPLY or self.measures != "coil_temperature"):
            raise ValueError(
                f'driver = "{self.driver}" needs address = "{SUPPLY}", measures = "coil_temperature", at_rest_degC '
                "(temperature before the run) and at_rest_A (current with which the resistance is then measured)"
            )
        if not self.is_coil and keys != (None, None):
            raise ValueError(f'at_rest_degC and at_rest_A are only for driver = "{CoilThermometer.name}"')
        return self

    @property
    def is_coil(self) -> bool:
        """Whether the sensor is the coil itself, whose resistance gives the temperature of the coil."""
        return self.driver == CoilThermometer.name


def check_sensors(sensors: Sequence[RigSensor], simulated: bool) -> None:
    """Raise ValueError if two sensors of a rig contradict each other, or if a sensor does not suit the rig.

    Parameters
    ----------
    sensors
        The sensors of a rig.
    simulated
        Whether supply and camera of the rig are virtual.
    """
    for number, sensor in enumerate(sensors):
        place = f"sensors.{number}"
        for other in sensors[:number]:
            if other.name == sensor.name:
                raise ValueError(f"{place}.name = {sensor.name!r}: another sensor has this name")
            if other.measures == sensor.measures != "other":
                raise ValueError(
                    f'{place}.measures = "{sensor.measures}": the sensor {other.name} already measures this quantity'
                )
        if sensor.is_coil:
            continue
        if simulated != (sensor.address == EMULATED):
            should = f'"{EMULATED}", because this rig is simulated' if simulated else "the address of an instrument"
            raise ValueError(f"{place}.address = {sensor.address!r} should be {should}")
        if simulated and (sensor.driver not in SENSOR_DIALECTS or sensor.measures == "other"):
            raise ValueError(
                f"{place}: a sensor of the virtual rig should have one of the drivers {', '.join(SENSOR_DIALECTS)}, "
                f'and its key "measures" should be one of {", ".join(UNITS)}'
            )
