"""Read F.W. Bell 5080 gaussmeters."""

from __future__ import annotations

import re
from typing import ClassVar

from eimi_drivers.interfaces import SensorReading
from eimi_drivers.sensors.base import SensorBase

_FIELD = re.compile(r"\s*([+-]?\d+(?:\.\d*)?(?:[Ee][+-]?\d+)?)\s*([GT])\s*;?\s*")
_MILLITESLA = {"G": 0.1, "T": 1000.0}


class FWBell5080(SensorBase):
    """Driver of an F.W. Bell 5080 gaussmeter on a serial port (2400 bit/s, 8 data bits, no parity).

    The answer to ``:MEASure:FLUX?`` is the field with its unit, such as ``12.34G``. A semicolon may follow. The query
    and the form of the answer are taken from PyMeasure 0.16 (class FWBell5080), because the manual was not available.
    The user must select gauss or tesla at the front panel; a value in A/m raises ReplyNotUnderstood. The meter reports
    no uncertainty.
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
