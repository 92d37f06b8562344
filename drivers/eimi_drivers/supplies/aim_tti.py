"""Drive Aim-TTi supplies of the QL (Series II), MX, QPX and CPX series over TCP (port 9221), USB or RS-232."""

# Sources: MX180T/TP instruction manual, page 35 (commands and responses). QPX600D/DP instruction manual, page 30 (limit
# event status register). Manual of the Sorensen XDL series II, which is the same as the QL series, pages 33 (limit
# event status register) and 38 (lock, trips, modes). The register of the CPX series and the error numbers come from
# drivers of other projects (msl-equipment for MX, python-dvg-devices for QL), because these pages of the manuals were
# not available.

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from eimi_drivers.interfaces import Clock, Identity, InstrumentError, Limits, Reading
from eimi_drivers.supplies.base import SupplyBase
from eimi_drivers.supplies.protections import PROTECTION_MARGIN, STAYS_ON, armed_in_words, check_level
from eimi_drivers.supplies.scpi_profiles import OVER_BOTH, TOO_HOT
from eimi_drivers.supplies.transport import Transport
from eimi_drivers.supplies.values import number_in
from eimi_drivers.supplies.visa import open_visa

LONGEST_LINE = 256

LAST_HARDWARE_ERROR = 99
"""The largest error number that means a hardware fault; the smallest is 1."""

OUT_OF_RANGE = frozenset({100, 120})
"""Numbers of the errors that a set-point outside the present range of the output causes."""

ERRORS: Mapping[int, str] = {
    100: "the number is outside the permitted range",
    101: "the stored settings are damaged",
    102: "no settings are stored there",
    103: "the command is not valid in the present state, or the supply has no such output",
    104: "the command is not valid while the output is on, or the range could not be changed",
    200: "another interface holds the lock (IFLOCK)",
}
"""The meaning of each number that ``EER?`` answers on the CPX, MX and QPX series."""

ERRORS_OF_QL: Mapping[int, str] = {
    116: "no settings are stored there",
    117: "the stored settings are damaged",
    120: "the number is too large or too small",
    123: "the stored settings cannot be recalled now",
    124: "the range cannot be changed now",
    200: "another interface holds the lock (IFLOCK)",
}
"""The meaning of each number that ``EER?`` answers on the QL series."""

EVENTS: Mapping[int, str] = {
    0x20: "the supply did not understand a message",
    0x08: "the output did not reach a value within 5 s",
    0x04: "an answer was not read, or was read without a query",
}
"""The meaning of each bit of ``*ESR?`` that reports an error without a number.

Bit 0x10 reports an error with a number; the answer to ``EER?`` is this number.
"""

NUMBERED_ERROR = 0x10


@dataclass(frozen=True)
class Series:
    """The properties of one series of Aim-TTi supplies.

    Parameters
    ----------
    trips : mapping of int to str
        Bits of the limit event status register (``LSR1?``) that report a tripped protection, with their meaning.
    errors : mapping of int to str
        Meaning of each number that ``EER?`` answers.
    current_step_A : str
        Step of the current set-points (A) as decimal text.
    range : str
        Query for the range of an output; empty if the series has one range.
    switches_protections : bool
        True if a protection must be switched on in addition to setting its trip level (threshold).
    """

    trips: Mapping[int, str]
    errors: Mapping[int, str] = field(default_factory=lambda: ERRORS)
    current_step_A: str = "0.01"
    range: str = ""
    switches_protections: bool = False


_OVP, _OCP = "over-voltage protection tripped", "over-current protection tripped"
_SENSE = "a fault at the sense terminals switched the output off"
_FATAL = "a fault switched the output off; the fault is cleared only if the mains of the supply are switched off"

SERIES: Mapping[str, Series] = {
    "QL": Series(
        {0x04: _OVP, 0x08: _OCP, 0x10: TOO_HOT, 0x20: _SENSE, 0x80: "the auxiliary output tripped"},
        ERRORS_OF_QL,
        "0.001",
        "RANGE{channel}?",
    ),
    "MX": Series({0x04: _OVP, 0x08: _OCP, 0x40: _FATAL}, ERRORS, "0.001", "VRANGE{channel}?", True),
    "QPX": Series({0x08: _OVP, 0x10: _OCP, 0x20: _SENSE, 0x40: _FATAL}),
    "CPX": Series({0x04: _OVP, 0x08: _OCP, 0x40: _FATAL}),
}
"""The series by the first letters of their models."""

_MODEL = re.compile(r"[^,]*,\s*(QL|MX|QPX|CPX)")


class AimTtiSupply(SupplyBase):
    """Driver of one output of an Aim-TTi supply. The channel in the address, such as ``#2``, is the output's number.

    The driver requests exclusive control of the supply before the first set-point, and releases the control after it
    has switched the output off. It never changes the range of an output.
    """

    name = "aim-tti"
    current_step_A = "0.01"
    channels = (1, 3)
    protections = OVER_BOTH
    without_contact = STAYS_ON + armed_in_words(protections)

    def __init__(self, link: Transport, limits: Limits, clock: Clock) -> None:
        super().__init__(link, limits, clock)
        self._identified_series: Series | None = None
        self._in_control = False
        self._tripped = 0

    @classmethod
    def connect(cls, address: str) -> Transport:
        """Open the VISA resource or the serial line at the address, and return the connection."""
        return open_visa(address)

    def identify(self) -> Identity:
        """Return the identity from the answer to ``*IDN?``.

        Raises
        ------
        AnotherSupply
            The identity has changed since the driver was opened.
        InstrumentError
            The supply belongs to none of the series in `SERIES`.
        """
        identity = self._identity(self._ask("*IDN?"))
        match = _MODEL.match(identity.text)
        if match is None:
            raise InstrumentError(
                f"{self._link.address}: {identity.text!r} belongs to none of the series that the driver aim-tti "
                f"supports: {', '.join(SERIES)}"
            )
        self._identified_series = SERIES[match[1]]
        self.current_step_A = self._identified_series.current_step_A
        return identity

    def output_on(self) -> bool:
        """Return whether the supply reports that its output is on."""
        question = self._fill("OP{channel}?")
        reply = self._ask(question)
        if reply.strip() not in {b"0", b"1"}:
            raise self._not_understood(question, reply, "0 or 1")
        return reply.strip() == b"1"

    def measure(self) -> Reading:
        """Return the measured output current (A) and output voltage (V)."""
        return Reading(
            current_A=self._value("I{channel}O?", unit="A"),
            voltage_V=self._value("V{channel}O?", unit="V"),
        )

    @property
    def _series(self) -> Series:
        if self._identified_series is None:
            self.identify()
        assert self._identified_series is not None
        return self._identified_series

    def _fill(self, message: str) -> str:
        return message.format(channel=self._channel)

    def _send(self, message: str) -> None:
        self._link.write(self._fill(message).encode("ascii") + b"\n")

    def _ask(self, question: str) -> bytes:
        return self._question(self._fill(question).encode("ascii") + b"\n", LONGEST_LINE, b"\n")

    def _value(self, question: str, name: str = "", unit: str = "") -> float:
        """Send a query, and return the number between `name` and `unit` in the answer, such as ``V1 12.00``."""
        reply = self._ask(question)
        before, after = self._fill(f"{name} " if name else "").encode("ascii"), unit.encode("ascii")
        text = reply.strip()
        number = None
        if text.startswith(before) and text.endswith(after):
            number = number_in(text.removeprefix(before).removesuffix(after))
        if number is None:
            example = f"{before.decode('ascii')}0.70{unit}"
            raise self._not_understood(self._fill(question), reply, f"a value such as {example}")
        return number

    def _register(self, question: str) -> int:
        reply = self._ask(question)
        if not reply.strip().isdigit():
            raise self._not_understood(self._fill(question), reply, "a whole number")
        return int(reply)

    def _take_control(self) -> None:
        """Clear old errors and request exclusive control; raise InstrumentError if the supply refuses the control."""
        if self._in_control:
            return
        self._send("*CLS")
        reply = self._ask("IFLOCK")
        if reply.strip() != b"1":
            raise InstrumentError(
                f"{self._link.address}: the supply refuses control by this program (the answer to IFLOCK is "
                f"{reply.strip().decode('latin-1')!r}): another interface holds the lock, or the supply's web page "
                "forbids settings through this interface. Close the other program, or press LOCAL at the front panel"
            )
        self._in_control = True

    def _disarm_watchdog(self) -> None:
        """Release exclusive control of the supply, if this interface has it; these supplies have no watchdog."""
        # SupplyBase calls this method after the output was switched off.
        self._in_control = False
        if self._ask("IFLOCK?").strip() == b"1":
            self._ask("IFUNLOCK")

    def _raise_reported_errors(self) -> None:
        events = self._register("*ESR?")
        reported = [words for bit, words in EVENTS.items() if events & bit]
        if events & NUMBERED_ERROR:
            reported.append(self._error_in_words(self._register("EER?")))
        if reported:
            raise InstrumentError(f"{self._link.address}: the supply reports: {'; '.join(reported)}")

    def _error_in_words(self, number: int) -> str:
        series = self._series
        if 1 <= number <= LAST_HARDWARE_ERROR:
            return f"error {number}: a fault of the supply's hardware"
        words = f"error {number}: {series.errors.get(number, 'the manual of the supply does not list this number')}"
        if number in OUT_OF_RANGE and series.range:
            question = self._fill(series.range)
            words += f" (the answer to {question} is {self._line(question, self._ask(question))})"
        return words

    def _trip(self) -> str:
        self._tripped |= self._register("LSR{channel}?")  # reading the register clears it
        return ", ".join(words for bit, words in self._series.trips.items() if self._tripped & bit)

    def _protect(self) -> None:
        self._take_control()
        self._send("TRIPRST")
        self._register("LSR{channel}?")
        self._tripped = 0
        levels = (
            ("OVP", "VP", f"{self.limits.voltage_V * PROTECTION_MARGIN:.2f}"),
            ("OCP", "CP", f"{self.limits.current_A * PROTECTION_MARGIN:.3f}"),
        )
        for command, _, level in levels:
            if self._series.switches_protections:
                self._send(f"{command}{{channel}} ON")
            self._send(f"{command}{{channel}} {level}")
        self._raise_reported_errors()
        for command, answered, level in levels:
            answer = self._value(f"{command}{{channel}}?", name=f"{answered}{{channel}}")
            check_level(
                self._link.address,
                self._fill(f"{command}{{channel}}?"),
                float(level),
                float(level) / PROTECTION_MARGIN,
                answer,
            )

    def _send_voltage(self, text: str) -> None:
        self._take_control()
        self._send(f"V{{channel}} {text}")

    def _send_current(self, text: str) -> None:
        if float(text) != 0:  # switching off needs no control
            self._take_control()
        self._send(f"I{{channel}} {text}")

    def _send_output(self, on: bool) -> None:
        self._send(f"OP{{channel}} {int(on)}")

    def _voltage_set(self) -> float:
        return self._value("V{channel}?", name="V{channel}")

    def _current_set(self) -> float:
        return self._value("I{channel}?", name="I{channel}")
