"""Drive TDK-Lambda Genesys supplies on a serial line.

Before the first use, compare the fault register (`FAULTS`) with the manual of your supply. If the supply uses other
bits, the driver does not notice a tripped protection.
"""

from __future__ import annotations

import re

from eimi_drivers.interfaces import (
    Clock,
    Identity,
    InstrumentDisconnected,
    InstrumentError,
    InstrumentTimeout,
    Limits,
    Reading,
)
from eimi_drivers.supplies.base import SupplyBase
from eimi_drivers.supplies.protections import PROTECTION_MARGIN, STAYS_ON, armed_in_words, check_level
from eimi_drivers.supplies.scpi_profiles import OVER_VOLTAGE
from eimi_drivers.supplies.transport import SerialTransport, Transport

LONGEST_LINE = 128
BLIND_GAP_S = 0.05
"""Wait (s) between messages that are sent without reading their answers."""

FAULTS = {
    0x02: "the mains failed",
    0x04: "the supply is too hot",
    0x08: "foldback protection tripped",
    0x10: "over-voltage protection tripped",
    0x20: "the supply was shut off at its rear connector",
    0x80: "the enable contact of the supply is open",
}
"""The meaning of each bit of the fault register, ``FR`` in the answer to ``STT?``.

Bit 0x40 is not a fault. This bit reports that the output is off.
"""

REFUSALS = {
    "E01": "the voltage is above the range, or above 95 % of the over-voltage protection",
    "E02": "the voltage is below the under-voltage limit (UVL)",
    "E04": "the over-voltage protection is below the voltage set-point plus 5 % of the rated voltage",
    "E06": "the under-voltage limit is above the voltage set-point",
    "E07": "the output cannot be switched on during a fault",
    "C01": "the supply does not know this message",
    "C02": "a parameter is missing",
    "C03": "the parameter is wrong",
    "C04": "the checksum is wrong",
    "C05": "the parameter is out of range",
}
"""The meaning of each error with which the supply refuses a message.

Source: TDK-Lambda, Genesys user manual 83-507-013, tables 7-1 and 7-2. The manuals of the 2.4 kW (83-517-000), 3.3 kW
(83-503-001) and 10/15 kW series (83-532-002, tables 8-1 and 8-2) have the same tables.

E01 refuses a voltage set-point above 95 % of the level of the over-voltage protection (OVP). E04 refuses an OVP level
below the voltage set-point plus 5 % of the rated voltage. Before the driver changes the voltage, it therefore sets the
OVP to its highest level. The driver sets the final OVP level before the output is switched on.
"""

READ_BACK_OF_RATING = 0.003
"""Assumed largest current that the supply measures when no current flows, divided by the rated current."""

_RATING = re.compile(r"GENH?(\d+(?:\.\d+)?)-(\d+(?:\.\d+)?)")
_REFUSAL = re.compile(rb"[EC]\d\d\s*")
_FAULT_REGISTER = re.compile(rb".*\bFR\(([0-9a-fA-F]{1,2})\)\s*", re.DOTALL)


class GenesysSupply(SupplyBase):
    """Driver of one TDK-Lambda Genesys supply on a serial line that several supplies can share.

    The channel in the address, such as ``#6``, is the number of the supply on the line. The driver switches the
    foldback protection off, because this protection trips in constant current. The over-voltage protection is set
    above the voltage limit of the driver.
    """

    name = "genesys"
    current_step_A = "0.01"
    read_backs = 2
    channels = (0, 30)
    default_channel = 6
    protections = OVER_VOLTAGE
    without_contact = (
        f"{STAYS_ON}; a Genesys+ has a watchdog: set it to 10 s in the menu of its front panel (manual GH10-100, 5.10)"
        + armed_in_words(protections)
    )

    def __init__(self, link: Transport, limits: Limits, clock: Clock) -> None:
        super().__init__(link, limits, clock)
        self._selected = False
        self._rated_A = 0.0
        self._greeting = (f"ADR {self._channel}", "RMT REM")

    @classmethod
    def connect(cls, address: str) -> Transport:
        """Open the serial port of the supply and return the connection."""
        return SerialTransport(address)

    def identify(self) -> Identity:
        """Return the identity of the supply, from its answers to ``IDN?`` and ``SN?``.

        Raises AnotherSupply if the identity has changed since the driver was opened.
        """
        return self._bind(self._model(), f"{self._line('SN?', self._ask('SN?'))}#{self._channel}")

    @property
    def reads_zero_within_A(self) -> float:
        """Return the largest current (A) that the supply measures when no current flows (an assumed value)."""
        if not self._rated_A:
            self._model()
        return READ_BACK_OF_RATING * self._rated_A

    def _model(self) -> str:
        """Return the answer to ``IDN?``, and store the rated current (A) that it contains."""
        model = self._line("IDN?", self._ask("IDN?"))
        if rating := _RATING.search(model):
            self._rated_A = float(rating[2])
        return model

    def output_on(self) -> bool:
        """Return whether the output is on, from the answer to ``OUT?``."""
        reply = self._ask("OUT?")
        if reply.strip() not in {b"ON", b"OFF"}:
            raise self._not_understood("OUT?", reply, "ON or OFF")
        return reply.strip() == b"ON"

    def measure(self) -> Reading:
        """Return the measured output current (A) and output voltage (V)."""
        return Reading(current_A=self._ask_value("MC?"), voltage_V=self._ask_value("MV?"))

    def _exchange(self, message: str) -> bytes:
        try:
            return self._question(message.encode("ascii") + b"\r", LONGEST_LINE, end=b"\r")
        except (InstrumentTimeout, InstrumentDisconnected):
            self._selected = False  # a supply that was without mains, or another supply, must be selected again
            raise

    def _ask(self, question: str) -> bytes:
        if not self._selected:
            for message in self._greeting:
                self._raise_unless_ok(message, self._exchange(message))
            self._selected = True
        reply = self._exchange(question)
        if _REFUSAL.fullmatch(reply):
            text = reply.strip().decode("ascii")
            meaning = f": {REFUSALS[text]}" if text in REFUSALS else ""
            raise InstrumentError(f"{self._link.address}: the supply answers {question} with error {text}{meaning}")
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
        level_V = self._ovp_V()
        self._command("FLD OFF")
        self._command(f"OVP {level_V:.2f}")
        check_level(self._link.address, "OVP?", level_V, self.limits.voltage_V, self._ask_value("OVP?"))
        if (reply := self._ask("FLD?").strip()) != b"OFF":
            raise self._not_understood("FLD?", reply, "OFF")

    def _ovp_V(self) -> float:
        """Return the voltage (V) at which the over-voltage protection trips."""
        identity = self._model()
        rating = _RATING.search(identity)
        if rating is None:
            raise InstrumentError(
                f"{self._link.address}: the answer to IDN? must contain a model with a rating such as GEN40-38, but it "
                f"is {identity!r}; the over-voltage protection cannot be set without the rating"
            )
        limit_V = self.limits.voltage_V
        return max(PROTECTION_MARGIN * limit_V, limit_V + 0.051 * float(rating[1]))

    def _send_voltage(self, text: str) -> None:
        self._command("OVM")  # highest OVP: a lower one would refuse the voltage (E01); `_protect` sets it again
        self._command(f"PV {text}")

    def _send_current(self, text: str) -> None:
        self._command(f"PC {text}")

    def _send_output(self, on: bool) -> None:
        if on:
            self._command("OUT ON")
            return
        if self._unanswered:
            self._send_off_unread()  # sent before any wait: perhaps only the answers of the supply are lost
        try:
            self._command("OUT OFF")
        except InstrumentError:
            self._send_off_unread()
            raise

    def _send_off_unread(self) -> None:
        """Send the messages that switch the output off, without reading any answer."""
        for message in (*self._greeting, "OUT OFF"):
            self._link.write(message.encode("ascii") + b"\r")
            self._clock.sleep(BLIND_GAP_S)

    def _voltage_set(self) -> float:
        return self._ask_value("PV?")

    def _current_set(self) -> float:
        return self._ask_value("PC?")
