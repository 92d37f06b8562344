"""Drive BK Precision XLN supplies over USB or RS-485."""

# Source: XLN series user manual (XLN3640), page 59 (list of commands) and page 74 (bits of STATUS?). Assumed:
# carriage return and line feed at the end of a message, because that page was not available, and the offset of the
# current meter (0.1 % of 40 A).

from __future__ import annotations

from eimi_drivers.interfaces import Identity, SetPointNotTaken
from eimi_drivers.supplies.profile import Profile
from eimi_drivers.supplies.protections import STAYS_ON, armed_in_words
from eimi_drivers.supplies.scpi import ScpiSupply
from eimi_drivers.supplies.scpi_profiles import OVER_BOTH, OVER_CURRENT_TRIPPED, OVER_VOLTAGE_TRIPPED, TOO_HOT

OUTPUT_BIT, ARMED_BITS = 0x000004, 0x0000C0
"""Bits of byte 0 of ``STATUS?``: the bit that reports that the output is on, and the two bits of armed protections."""

TRIPS = {
    0x8000: OVER_VOLTAGE_TRIPPED,
    0x4000: OVER_CURRENT_TRIPPED,
    0x2000: "over-power protection tripped",
    0x1000: "the output tripped at a change from constant current to constant voltage",
    0x0800: "the output tripped at a change from constant voltage to constant current",
    0x0400: "the mains voltage is too low",
    0x0200: TOO_HOT,
}
"""Bits of byte 1 of ``STATUS?``, each with the reason for which the supply switched the output off."""

STATUS_DIGITS = 6
"""Number of hexadecimal digits in the answer to ``STATUS?``: three bytes, the highest byte first."""


class XlnSupply(ScpiSupply):
    """Driver of a BK Precision XLN supply."""

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
        """Return the identity from the answers to ``MODEL?`` and ``VERSION?``, without a serial number.

        Raises AnotherSupply if the identity has changed since the driver was opened.
        """
        parts = (self._line(question, self._ask(question)) for question in ("MODEL?", "VERSION?"))
        return self._bind(" ".join(parts), "")

    def output_on(self) -> bool:
        """Return whether the output is on, from the answer to ``STATUS?``."""
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
                f"{self._link.address}: the protections of the supply were not switched on: the answer to STATUS? is "
                f"{status:06X}, but bits 7 and 6 should be set"
            )
