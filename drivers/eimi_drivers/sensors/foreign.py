"""Raise every error of another package's sensor driver as an InstrumentError with one line of text."""

from __future__ import annotations

from typing import Any

from eimi_drivers.interfaces import (
    Identity,
    InstrumentError,
    ReplyNotUnderstood,
    Sensor,
    SensorReading,
    raised,
)


class ForeignSensor:
    """A sensor of another package, whose errors are raised as InstrumentError.

    Parameters
    ----------
    sensor : Sensor
        Open sensor.
    name : str
        Name of the driver, for messages.
    address : str
        Address of the sensor, for messages.
    """

    def __init__(self, sensor: Sensor, name: str, address: str) -> None:
        self._sensor = sensor
        self._where = f"{name} sensor {address}"
        self.name, self.timeout_s = sensor.name, sensor.timeout_s

    def identify(self) -> Identity:
        """Return the identity that the sensor reports."""
        return self._checked("identify", Identity)

    def read(self) -> SensorReading:
        """Return the present value of the sensor."""
        return self._checked("read", SensorReading)

    def close(self) -> None:
        """Release the port."""
        self._call("close")

    def _call(self, member: str) -> Any:
        try:
            return getattr(self._sensor, member)()
        except InstrumentError:
            raise
        except Exception as error:
            raise InstrumentError(f"{self._where}: its driver raised {raised(error)} in {member}") from error

    def _checked(self, member: str, kind: type[Any]) -> Any:
        answer = self._call(member)
        if not isinstance(answer, kind):
            raise ReplyNotUnderstood(
                f"{self._where}: its driver returned {answer!r} from {member}; it should return a {kind.__name__}"
            )
        return answer
