"""Spoiling an emulated instrument on purpose."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum

from eimi_drivers.clock import WallClock
from eimi_drivers.interfaces import Clock
from eimi_drivers.supplies.transport import Responder


class Fault(Enum):
    """What can go wrong on a line. What goes wrong in a supply is in `CoilSupply`: trip, locked, hunting_A."""

    SILENCE = "the message is lost and nothing answers"
    GARBAGE = "the message is obeyed but the answer is unreadable"
    PARTIAL = "the message is obeyed but the second half of the answer is lost"
    SLOW = "the message is obeyed but the answer comes late"
    DISCONNECT = "the line is cut, for good"
    DROP = "the line is cut once, and can be opened anew"


class FaultyInstrument:
    """An emulated instrument that can be made to fail, from the next message on.

    late_s: how late a slow answer comes, in the time of `clock` (the wall clock unless given).
    """

    garbage = b"\xfe\x81?\x9c\n#\r"

    def __init__(self, instrument: Responder, clock: Clock | None = None, late_s: float = 0.3) -> None:
        self.late_s = late_s
        self._instrument = instrument
        self._clock = clock or WallClock()
        self._fault: Fault | None = None
        self._concerns: Callable[[bytes], bool] = bool
        self._cut = False

    def inject(self, fault: Fault | None, concerns: Callable[[bytes], bool] = bool) -> None:
        """Fail so for every message that `concerns` is true of (all, unless given); None ends it."""
        self._fault, self._concerns = fault, concerns

    def receive(self, data: bytes) -> bytes:
        """Take bytes, return the answers, or fail. Raises ConnectionResetError when the line is cut."""
        fault = self._fault if self._concerns(data) else None
        if fault is Fault.DISCONNECT or self._cut:
            self._cut = True
            raise ConnectionResetError("the line was cut")
        if fault is Fault.DROP:
            self._fault = None
            raise ConnectionResetError("the line was dropped")
        if fault is Fault.SILENCE:
            return b""
        answer = self._instrument.receive(data)
        if fault is Fault.SLOW and answer:
            self._clock.sleep(self.late_s)
        if fault is Fault.PARTIAL:
            return answer[: len(answer) // 2]
        return self.garbage if fault is Fault.GARBAGE and answer else answer
