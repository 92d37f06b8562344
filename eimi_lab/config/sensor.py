"""The table [[sensors]] of a rig: gaussmeters, thermometers and other sensors that are read during a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from pydantic import Field, field_validator, model_validator

from eimi_drivers.emulators.sensors import SENSOR_DIALECTS
from eimi_drivers.installed import did_you_mean
from eimi_drivers.sensors.coil_thermometer import CoilThermometer
from eimi_drivers.sensors.sensor_names import SENSORS
from eimi_drivers.supplies.transport import check_address
from eimi_lab.config.interlock import READINGS
from eimi_lab.config.toml import Table

EMULATED = "virtual"
"""The address of a sensor of the virtual rig."""

SUPPLY = "supply"
"""The address of the coil as a thermometer."""

Quantity = Literal["field", "specimen_temperature", "coil_temperature", "other"]

UNITS: dict[str, str] = {"field": "mT", "specimen_temperature": "degC", "coil_temperature": "degC"}
"""The unit that a sensor of each quantity must have; another quantity may have any unit."""


class RigSensor(Table):
    """A sensor, which is read with every stored frame and every 1.5 s; its values are in the dataset."""

    name: str = Field(pattern=r"^[a-z][a-z0-9_]{0,39}$")
    """Name of the sensor in the dataset and in [[interlocks]]: small letters, digits and underscores."""
    driver: str
    """lakeshore-425, lakeshore-475, fwbell-5080, text-line, or the name of a driver from another package.
    coil-resistance: the coil itself, by the voltage and the current of the supply."""
    address: str = Field(min_length=1)
    """A serial port or a VISA resource; "virtual" for an emulated sensor of the virtual rig, "supply" for
    coil-resistance."""
    measures: Quantity = "other"
    """field: along the coil's axis, positive for a positive current; a fit uses it in place of coil_constant_mT_per_A.
    specimen_temperature or coil_temperature. other: the values are stored and can have an interlock."""
    at_magnet: float = 1.0
    """Field at the magnet divided by the field at the probe; negative if the probe is mounted the other way round."""
    uncertainty: float | None = Field(default=None, ge=0)
    """Standard uncertainty of one reading, in its unit; by default the uncertainty that the sensor states."""
    uncertainty_share: float | None = Field(default=None, ge=0, le=0.5)
    """Standard uncertainty that all readings share, as a fraction: from the probe's calibration and from at_magnet."""

    at_rest_degC: float | None = Field(default=None, gt=-50, lt=100)
    """For coil-resistance: temperature of the coil before the run, which is that of the room."""
    at_rest_A: float | None = Field(default=None, gt=0)
    """For coil-resistance: current with which the resistance at rest is measured, before the first state."""

    @field_validator("driver")
    @classmethod
    def _exists(cls, driver: str) -> str:
        names = [*SENSORS, CoilThermometer.name]
        if driver not in names:
            raise ValueError(f"is not a driver; there are {', '.join(names)}{did_you_mean(driver, names)}")
        return driver

    @field_validator("address")
    @classmethod
    def _opens_no_file(cls, address: str) -> str:
        check_address(address)
        return address

    @model_validator(mode="after")
    def _consistent(self) -> RigSensor:
        if self.name in READINGS:
            raise ValueError(f"name = {self.name!r} is the name of a reading of the supply; choose another one")
        if self.at_magnet == 0 or (self.at_magnet != 1 and self.measures != "field"):
            raise ValueError(
                f"at_magnet = {self.at_magnet:g} should be the ratio of two fields, not 0, and belongs to "
                'measures = "field"'
            )
        keys = (self.at_rest_degC, self.at_rest_A)
        if self.is_coil and (None in keys or self.address != SUPPLY or self.measures != "coil_temperature"):
            raise ValueError(
                f'driver = "{self.driver}" needs address = "{SUPPLY}", measures = "coil_temperature", at_rest_degC and '
                "at_rest_A"
            )
        if not self.is_coil and keys != (None, None):
            raise ValueError(f'at_rest_degC and at_rest_A belong to driver = "{CoilThermometer.name}"')
        return self

    @property
    def is_coil(self) -> bool:
        """Whether the coil itself is the sensor."""
        return self.driver == CoilThermometer.name


def check_sensors(sensors: Sequence[RigSensor], simulated: bool) -> None:
    """Raise ValueError if two sensors have the same name or role, or if an emulated sensor is on a real bench.

    Parameters
    ----------
    sensors
        The sensors of a rig.
    simulated
        Whether the rig is the virtual rig in simulated time.
    """
    for number, sensor in enumerate(sensors):
        place = f"sensors.{number}"
        for other in sensors[:number]:
            if other.name == sensor.name:
                raise ValueError(f"{place}.name = {sensor.name!r}: another sensor has this name")
            if other.measures == sensor.measures != "other":
                raise ValueError(f'{place}.measures = "{sensor.measures}": the sensor {other.name} measures it already')
        if sensor.is_coil:
            continue
        if simulated != (sensor.address == EMULATED):
            should = f'"{EMULATED}", because this rig is simulated' if simulated else "that of an instrument"
            raise ValueError(f"{place}.address = {sensor.address!r} should be {should}")
        if simulated and (sensor.driver not in SENSOR_DIALECTS or sensor.measures == "other"):
            raise ValueError(
                f"{place}: a sensor of the virtual rig has one of the drivers {', '.join(SENSOR_DIALECTS)}, and "
                f"measures one of {', '.join(UNITS)}"
            )
