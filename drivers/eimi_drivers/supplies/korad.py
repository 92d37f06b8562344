"""Drive Korad KA/KD supplies, which Tenma, RND and Velleman also sell, on a serial line."""

from __future__ import annotations

import re
from contextlib import suppress

from eimi_drivers.interfaces import (
    Clock,
    Identity,
    InstrumentTimeout,
    Limits,
    ProtectionTripped,
    Reading,
)
from eimi_drivers.supplies.base import SupplyBase
from eimi_drivers.supplies.transport import SerialTransport, Transport

MESSAGE_GAP_S = 0.08
"""Wait (s) after each message.

Messages have no terminator, and the supply ignores two messages between which there is no pause.
"""

OUTPUT_BIT = 0x40
PROTECTION_BITS = 0x20 | 0x80
"""Bits of the status byte that belong to protections.

With some firmware a bit means that the protection has tripped, with other firmware that the protection is armed.
"""

WHOLE_IDENTITY_GAP_S, IDENTITY_GAP_S = 0.05, 0.3
"""Longest waits (s) for the next byte of the identity.

The first wait is used after a text that ends as an identity usually does, the second wait after any other text. The
identity has no terminator. A serial line over a network can deliver it in two pieces.
"""

_WHOLE_IDENTITY = re.compile(rb".*V\d\.\d( SN:\d{8})?[\s\0]*", re.DOTALL)
_VALUE_BYTES = 5
_AMPERES = re.compile(rb"\d\.\d{3}|[1-9]\d\.\d{2}")
_VOLTS = re.compile(rb"\d{2}\.\d{2}")


class KoradSupply(SupplyBase):
    """Driver of a one-channel Korad supply on a serial line (9600 bit/s).

    The driver switches the over-current protection off, because this protection trips as soon as the current reaches
    its set-point. The supply still limits the current to the set-point.
    """

    name = "korad"
    read_backs = 2

    def __init__(self, link: Transport, limits: Limits, clock: Clock) -> None:
        super().__init__(link, limits, clock)
        self._armed_bits = 0

    @classmethod
    def connect(cls, address: str) -> Transport:
        """Open the serial port of the supply and return the connection."""
        return SerialTransport(address)

    def identify(self) -> Identity:
        """Return the identity of the supply, from its answer to ``*IDN?``.

        Raises AnotherSupply if the identity has changed since the driver was opened.
        """
        reply = self._ask("*IDN?", 1)
        with suppress(InstrumentTimeout):
            while len(reply) < 64:
                gap_s = WHOLE_IDENTITY_GAP_S if _WHOLE_IDENTITY.fullmatch(reply) else IDENTITY_GAP_S
                reply += self._link.read(1, gap_s)
        return self._identity(reply)

    def set_output(self, on: bool) -> None:
        """Switch the output on or off, and verify that the output has switched.

        Raises SetPointNotTaken if the output has not switched.
        """
        super().set_output(on)
        if on:
            self._armed_bits = self._status() & PROTECTION_BITS

    def output_on(self) -> bool:
        """Return whether the output is on, from the status byte."""
        return bool(self._status() & OUTPUT_BIT)

    def measure(self) -> Reading:
        """Return the measured output current (A, resolution 1 mA) and output voltage (V, resolution 10 mV)."""
        return Reading(
            current_A=self._ask_value("IOUT1?", _AMPERES, "amperes such as 0.700"),
            voltage_V=self._ask_value("VOUT1?", _VOLTS, "volts such as 12.00"),
        )

    def check(self) -> None:
        """Raise ProtectionTripped if a protection has tripped, or if a person has switched the output off."""
        if not self._switched_on:
            return
        status = self._status()
        tripped = status & PROTECTION_BITS & ~self._armed_bits
        if tripped or not status & OUTPUT_BIT:
            raise ProtectionTripped(
                f"{self._link.address}: {'' if tripped else 'perhaps '}a protection tripped"
                f"{'' if tripped else ', or a person switched the output off'}: status byte {status:#04x}, "
                f"output {'on' if status & OUTPUT_BIT else 'off'}"
            )

    def _protect(self) -> None:
        self._send("OCP0")

    def _send(self, message: str) -> None:
        self._link.write(message.encode("ascii"))
        self._clock.sleep(MESSAGE_GAP_S)

    def _ask(self, question: str, size: int) -> bytes:
        return self._question(question.encode("ascii"), size, pause_s=MESSAGE_GAP_S)

    def _status(self) -> int:
        return self._ask("STATUS?", 1)[0]

    def _ask_value(self, question: str, form: re.Pattern[bytes], expected: str) -> float:
        # The answer to ISET1? has a meaningless sixth byte; the next write discards it.
        reply = self._ask(question, _VALUE_BYTES)
        if not form.fullmatch(reply):
            raise self._not_understood(question, reply, expected)
        return float(reply)

    def _send_voltage(self, text: str) -> None:
        self._send(f"VSET1:{text}")

    def _send_current(self, text: str) -> None:
        self._send(f"ISET1:{text}")

    def _send_output(self, on: bool) -> None:
        self._send("OUT1" if on else "OUT0")

    def _voltage_set(self) -> float:
        return self._ask_value("VSET1?", _VOLTS, "volts such as 12.00")

    def _current_set(self) -> float:
        return self._ask_value("ISET1?", _AMPERES, "amperes such as 0.700")
