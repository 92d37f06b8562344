"""A microcontroller with a sensor that answers in lines of text; see docs/howto/measure_the_field.md."""

from __future__ import annotations

import re
from typing import ClassVar

from eimi_drivers.interfaces import Identity, InstrumentTimeout, SensorReading
from eimi_drivers.sensors.base import SensorBase

STARTS_WITHIN_S = 3
"""Many boards restart when their port is opened, and answer only after their boot loader, within this time (s)."""

_UNIT = re.compile(r"[A-Za-z%/°]{1,12}")


class TextLine(SensorBase):
    """Read a sensor over a serial port (115200 baud, 8 data bits, no parity) with two queries.

    ``*IDN?`` is answered by one line, such as ``my lab,hall-board,1,1.0``. ``READ?`` is answered by a line with value,
    unit and standard uncertainty, separated by spaces: ``1.2345 mT 0.02``. The uncertainty may be left out. Every line
    ends with a line feed; a carriage return before it is ignored.
    """

    name: str = "text-line"
    baud_rate: ClassVar[int] = 115200

    def identify(self) -> Identity:
        """Ask ``*IDN?``; a board that has just been opened has `STARTS_WITHIN_S` to start."""
        if self._bound is None:
            for _ in range(STARTS_WITHIN_S - 1):
                try:
                    return super().identify()
                except InstrumentTimeout:
                    continue
        return super().identify()

    def read(self) -> SensorReading:
        """Ask for the value with its unit and its standard uncertainty."""
        answer = self._ask("READ?")
        parts = answer.split()
        if len(parts) not in (2, 3) or not _UNIT.fullmatch(parts[1]):
            raise self._not_understood("READ?", answer, "value, unit and standard uncertainty such as 1.2345 mT 0.02")
        value, *uncertainty = (self._number("READ?", part, "1.2345") for part in (parts[0], *parts[2:]))
        if uncertainty and uncertainty[0] < 0:
            raise self._not_understood("READ?", answer, "a standard uncertainty of 0 or above")
        return self._reading(value, parts[1], uncertainty[0] if uncertainty else None)
