"""TDK-Lambda Genesys over its serial line: lines ending with a carriage return, setters answered `OK`.

The layout of `STT?` and the bits of its fault register are to be checked against the manual of the unit in hand.
"""

from __future__ import annotations

import re

from eimi_drivers.interfaces import (
    Clock,
    Identity,
    InstrumentError,
    InstrumentTimeout,
    Limits,
    Reading,
)
from eimi_drivers.supplies.base import PROTECTION_MARGIN, STAYS_ON, SupplyBase
from eimi_drivers.supplies.transport import SerialTransport, Transport

LONGEST_LINE = 128
BLIND_GAP_S = 0.05
"""Between messages that are sent without waiting for their answers."""

FAULTS = {
    0x02: "the mains failed",
    0x04: "it is too hot",
    0x08: "foldback protection tripped",
    0x10: "over-voltage protection tripped",
    0x20: "it was shut off at its rear connector",
    0x80: "its enable contact is open",
}
"""Bits of the fault register, `FR` of `STT?`. Bit 0x40, the output being off, is no fault."""

REFUSALS = {
    "E01": "the voltage is above the range, or above 95 % of the over-voltage protection",
    "E02": "the voltage is below the under-voltage limit (UVL)",
    "E04": "the over-voltage protection is below the voltage set and 5 % of the rating",
    "E06": "the under-voltage limit is above the voltage set",
    "E07": "the output cannot be switched on during a fault",
    "C01": "it does not know this message",
    "C02": "a parameter is missing",
    "C03": "the parameter is wrong",
    "C04": "the checksum is wrong",
    "C05": "it is out of range",
}
"""TDK-Lambda, Genesys user manual 83-507-013, tables 7-1 and 7-2; the same in those of the 2.4 kW (83-517-000), 3.3
kW (83-503-001) and 10/15 kW series (83-532-002, tables 8-1 and 8-2).

They give the order of voltage and over-voltage protection: E01 refuses a voltage above 95 % of the OVP, E04 one below
the voltage set and 5 % of the rating. So a rising voltage wants the OVP out of its way first, and set after it.
"""

READ_BACK_OF_RATING = 0.003
"""See `GenesysSupply.reads_zero_within_A`."""

_RATING = re.compile(r"GENH?(\d+(?:\.\d+)?)-(\d+(?:\.\d+)?)")
_REFUSAL = re.compile(rb"[EC]\d\d\s*")
_FAULT_REGISTER = re.compile(rb".*\bFR\(([0-9a-fA-F]{1,2})\)\s*", re.DOTALL)


class GenesysSupply(SupplyBase):
    """TDK-Lambda Genesys. The channel of its address, `#6`, is the unit's own address on the line.

    Foldback protection is switched off before the output is switched on: it trips in constant current, where
    a supply that feeds a coil always works. Over-voltage protection is set above the driver's limit.

    Setters are answered `OK` by a unit whose front panel is held, too. So every read-back must be right twice.
    """

    name = "genesys"
    current_step_A = "0.01"
    read_backs = 2
    channels = (0, 30)
    default_channel = 6
    without_contact = (
        f"{STAYS_ON}; a Genesys+ has a watchdog in its front panel's menu (manual GH10-100, 5.10), a run bears 10 s"
    )

    def __init__(self, link: Transport, limits: Limits, clock: Clock) -> None:
        super().__init__(link, limits, clock)
        self._selected = False
        self._rated_A = 0.0
        self._greeting = (f"ADR {self._channel}", "RMT REM")

    @classmethod
    def connect(cls, address: str) -> Transport:
        """Open the serial port."""
        return SerialTransport(address)

    def identify(self) -> Identity:
        """Ask IDN?, and SN? for the serial number; the unit's own address on the line is part of what is unique."""
        return self._bind(self._model(), f"{self._line('SN?', self._ask('SN?'))}#{self._channel}")

    @property
    def reads_zero_within_A(self) -> float:
        """Return 0.3 % of the rated current: an assumed read-back offset, not checked against a manual.

        The rating is the second number of the model: 38 A of GEN40-38.
        """
        if not self._rated_A:
            self._model()
        return READ_BACK_OF_RATING * self._rated_A

    def _model(self) -> str:
        """Ask IDN?, and note the rated current if the answer has it."""
        model = self._line("IDN?", self._ask("IDN?"))
        if rating := _RATING.search(model):
            self._rated_A = float(rating[2])
        return model

    def output_on(self) -> bool:
        """Whether the output is on: OUT?."""
        reply = self._ask("OUT?")
        if reply.strip() not in {b"ON", b"OFF"}:
            raise self._not_understood("OUT?", reply, "ON or OFF")
        return reply.strip() == b"ON"

    def measure(self) -> Reading:
        """Measure the output."""
        return Reading(current_A=self._ask_value("MC?"), voltage_V=self._ask_value("MV?"))

    def _exchange(self, message: str) -> bytes:
        try:
            return self._question(message.encode("ascii") + b"\r", LONGEST_LINE, end=b"\r")
        except InstrumentTimeout:
            self._selected = False  # a unit that was switched off and on has forgotten that it was
            raise

    def _ask(self, question: str) -> bytes:
        if not self._selected:
            for message in self._greeting:
                self._raise_unless_ok(message, self._exchange(message))
            self._selected = True
        reply = self._exchange(question)
        if _REFUSAL.fullmatch(reply):
            text = reply.strip().decode("ascii")
            means = f": {REFUSALS[text]}" if text in REFUSALS else ""
            raise InstrumentError(f"{self._link.address}: the instrument answers {question} with error {text}{means}")
        return reply

    def _raise_unless_ok(self, message: str, reply: bytes) -> None:
        if reply.strip() != b"OK":
            raise self._not_understood(message, reply, "OK")

    def _command(self, message: str) -> None:
        self._raise_unless_ok(message, self._ask(message))

    def _ask_value(self, question: str) -> float:
        return self._number(question, self._ask(question))

    def _trip(self) -> str:
        reply = self._ask("STT?")
        match = _FAULT_REGISTER.fullmatch(reply)
        if match is None:
            raise self._not_understood("STT?", reply, "a status that ends with FR(00)")
        register = int(match[1], 16)
        return ", ".join(text for bit, text in FAULTS.items() if register & bit)

    def _protect(self) -> None:
        self._command("FLD OFF")
        self._command(f"OVP {self._ovp_V():.2f}")

    def _ovp_V(self) -> float:
        """Above the limit by the margin, and by 5 % of the rating, below which the supply refuses it (E04)."""
        identity = self._model()
        rating = _RATING.search(identity)
        if rating is None:
            raise InstrumentError(
                f"{self._link.address}: its rating is not to be read from {identity!r}, such as GEN40-38, and without "
                "it the over-voltage protection cannot be set"
            )
        limit_V = self.limits.voltage_V
        return max(PROTECTION_MARGIN * limit_V, limit_V + 0.051 * float(rating[1]))

    def _send_voltage(self, text: str) -> None:
        self._command("OVM")  # a low OVP from before would refuse the voltage (E01); `_protect` sets it anew
        self._command(f"PV {text}")

    def _send_current(self, text: str) -> None:
        self._command(f"PC {text}")

    def _send_output(self, on: bool) -> None:
        if on:
            self._command("OUT ON")
            return
        if self._unanswered:
            self._say_off()  # before anything is waited for
        try:
            self._command("OUT OFF")
        except InstrumentError:
            self._say_off()
            raise

    def _say_off(self) -> None:
        """Say it all without waiting for answers, since it may be they alone that are lost."""
        for message in (*self._greeting, "OUT OFF"):
            self._link.write(message.encode("ascii") + b"\r")
            self._clock.sleep(BLIND_GAP_S)

    def _voltage_set(self) -> float:
        return self._ask_value("PV?")

    def _current_set(self) -> float:
        return self._ask_value("PC?")
