"""Read a microcontroller board with a sensor; see docs/howto/measure_the_field.md."""

from __future__ import annotations

import re
from contextlib import suppress
from typing import ClassVar

from eimi_drivers.interfaces import Identity, InstrumentTimeout, ReplyNotUnderstood, SensorReading
from eimi_drivers.sensors.base import LONGEST_LINE, SensorBase
from eimi_drivers.supplies.address import is_serial_port

STARTS_WITHIN_S = 3
"""Time (s) within which a board answers after its port was opened, because many boards then restart."""

LINES_AT_START = 10
"""Number of lines without a query after which a board is refused. A board may send fewer lines when it starts."""

QUIET_S = 0.2
"""If a board sends no line for this time (s), the driver assumes that it sends lines only as answers."""

_UNIT = re.compile(r"[A-Za-z%/°]{1,12}")
_READING = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s+[A-Za-z%/°]{1,12}(\s+\S+)?")


class TextLine(SensorBase):
    """Driver of a board with a sensor on a serial port (115200 bit/s, 8 data bits, no parity).

    The board answers ``*IDN?`` with a line such as ``my lab,hall-board,1,1.0``, and ``READ?`` with value, unit and
    (optional) standard uncertainty, such as ``1.2345 mT 0.02``.
    """

    name: str = "text-line"
    baud_rate: ClassVar[int] = 115200

    def identify(self) -> Identity:
        """Return the identity from the answer to ``*IDN?``, after the board has started.

        Raises AnotherSensor if the identity has changed since the driver was opened, and ReplyNotUnderstood if the
        board sends readings instead of an identity, or if a board on a serial port sends `LINES_AT_START` lines without
        a query at intervals below `QUIET_S` (s).
        """
        if self._bound is not None:
            return super().identify()
        identity = self._identity_after_start()
        if _READING.fullmatch(identity.text):
            self._bound = None
            example = "an identity such as my lab,hall-board,1,1.0; a board must send nothing without a query"
            raise self._not_understood("*IDN?", identity.text, example)
        if is_serial_port(self._link.address):
            self._refuse_unasked_text()
        return identity

    def _identity_after_start(self) -> Identity:
        for _ in range(STARTS_WITHIN_S - 1):
            with suppress(InstrumentTimeout):
                return super().identify()
        return super().identify()

    def _refuse_unasked_text(self) -> None:
        """Raise ReplyNotUnderstood if the board sends lines without a query: the driver could read them as answers."""
        for _ in range(LINES_AT_START):
            try:
                text = self._link.read(LONGEST_LINE, QUIET_S, b"\n")
            except InstrumentTimeout:
                return
        self._bound = None
        raise ReplyNotUnderstood(
            f"{self._link.address}: the board sends {text!r} without being asked; it must send one line after *IDN? or "
            "READ?, and nothing else"
        )

    def read(self) -> SensorReading:
        """Ask the sensor for a new value, and return it with its unit and, if sent, its standard uncertainty."""
        answer = self._ask("READ?")
        parts = answer.split()
        if len(parts) not in (2, 3) or not _UNIT.fullmatch(parts[1]):
            raise self._not_understood("READ?", answer, "value, unit and standard uncertainty such as 1.2345 mT 0.02")
        value, *uncertainty = (self._number("READ?", part, "1.2345") for part in (parts[0], *parts[2:]))
        if uncertainty and uncertainty[0] < 0:
            raise self._not_understood("READ?", answer, "a standard uncertainty of 0 or above")
        return self._reading(value, parts[1], uncertainty[0] if uncertainty else None)
