"""Drive BK Precision XLN supplies over USB or RS-485, with their own commands.

Source: XLN series user manual (XLN3640), page 59 (list of commands) and page 74 (bits of ``STATUS?``). The page that
states how a message ends was not at hand; a carriage return and a line feed are assumed. The offset of the meter,
0.1 % of 40 A, is assumed.
"""

from __future__ import annotations

from eimi_drivers.interfaces import Identity, SetPointNotTaken
from eimi_drivers.supplies.base import STAYS_ON, armed_in_words
from eimi_drivers.supplies.profile import Profile
from eimi_drivers.supplies.scpi import ScpiSupply
from eimi_drivers.supplies.scpi_profiles import OVER_BOTH, OVER_CURRENT_TRIPPED, OVER_VOLTAGE_TRIPPED, TOO_HOT

OUTPUT_BIT, ARMED_BITS = 0x000004, 0x0000C0
"""Bits of byte 0 of ``STATUS?``: the output is on; both protections are armed."""

TRIPS = {
    0x8000: OVER_VOLTAGE_TRIPPED,
    0x4000: OVER_CURRENT_TRIPPED,
    0x2000: "over-power protection tripped",
    0x1000: "it tripped from constant current to constant voltage",
    0x0800: "it tripped from constant voltage to constant current",
    0x0400: "the mains voltage is too low",
    0x0200: TOO_HOT,
}
"""Bits of byte 1 of ``STATUS?``; each reports that a protection has tripped."""

STATUS_DIGITS = 6
"""Number of hexadecimal digits of ``STATUS?``: three bytes, the highest first."""


class XlnSupply(ScpiSupply):
    """Drive a BK Precision XLN. Without an error queue, its refusal of a set-point is noticed at the read-back."""

    name = "bk-xln"
    ends_with = b"\r\n"
    profile = Profile(
        name,
        baud_rate=57600,
        measure_voltage="VOUT?",
        measure_current="IOUT?",
        protect=("CLR", "OVSET {voltage}", "OVP 1", "OISET {current}", "OCP 1"),
        armed=(("OVSET?", "{voltage}"), ("OISET?", "{current}")),
        protections=OVER_BOTH,
        on=("OUT 1",),
        off=("OUT 0",),
        errors="",
        reads_zero_within_A=0.04,
    )
    protections = profile.protections
    without_contact = STAYS_ON + armed_in_words(protections)
    current_step_A = "0.01"

    def identify(self) -> Identity:
        """Ask ``MODEL?`` and ``VERSION?``; the supply states no serial number. Raises AnotherSupply."""
        parts = (self._line(question, self._ask(question)) for question in ("MODEL?", "VERSION?"))
        return self._bind(" ".join(parts), "")

    def output_on(self) -> bool:
        """Read from ``STATUS?`` whether the output is on."""
        return bool(self._status() & OUTPUT_BIT)

    def _status(self) -> int:
        reply = self._ask("STATUS?")
        text = reply.strip().decode("latin-1")
        try:
            if len(text) == STATUS_DIGITS:
                return int(text, 16)
        except ValueError:
            pass
        raise self._not_understood("STATUS?", reply, "six hexadecimal digits such as 000084")

    def _trip(self) -> str:
        status = self._status()
        return ", ".join(words for bit, words in TRIPS.items() if status & bit)

    def _protect(self) -> None:
        super()._protect()
        status = self._status()
        if status & ARMED_BITS != ARMED_BITS:
            raise SetPointNotTaken(
                f"{self._link.address}: its own protection was not switched on (STATUS? is answered {status:06X}; "
                "bits 7 and 6 should be set)"
            )
