"""Read F.W. Bell 5080 gaussmeters."""

from __future__ import annotations

import re
from typing import ClassVar

from eimi_drivers.interfaces import SensorReading
from eimi_drivers.sensors.base import SensorBase

_FIELD = re.compile(r"\s*([+-]?\d+(?:\.\d*)?(?:[Ee][+-]?\d+)?)\s*([GT])\s*;?\s*")
_MILLITESLA = {"G": 0.1, "T": 1000.0}


class FWBell5080(SensorBase):
    """Driver of an F.W. Bell 5080 gaussmeter on a serial port; the unit at its front panel must be gauss or tesla.

    Source: class FWBell5080 of PyMeasure 0.16. The manual was not available.
    """

    name: str = "fwbell-5080"
    baud_rate: ClassVar[int] = 2400
    ends_with: ClassVar[bytes] = b"\r\n"

    def read(self) -> SensorReading:
        """Return the measured field, mT."""
        answer = self._ask(":MEASure:FLUX?")
        if not (match := _FIELD.fullmatch(answer)):
            raise self._not_understood(":MEASure:FLUX?", answer, "a field in gauss or tesla such as 12.34G")
        return self._reading(_MILLITESLA[match[2]] * float(match[1]), "mT")
