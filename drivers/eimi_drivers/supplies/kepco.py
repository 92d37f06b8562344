"""Drive Kepco BOP bipolar supplies in current mode over SCPI."""

# Sources: appendix B of the operator manuals of BOP-MG 1KW (firmware 2.01 to 4.11) and BOP-GL 1KW (firmware 3.05 and
# higher); for the interface card BIT 4886 the BIT 232F manual, page B-4, for a card with the same commands, because
# that page of the BIT 4886 manual (243-1303) was not available. The manuals advise against OUTP OFF on inductive loads:
# the supply then no longer controls the current in the load.

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from eimi_drivers.interfaces import SetPointNotTaken
from eimi_drivers.supplies.protections import STAYS_ON, armed_in_words
from eimi_drivers.supplies.scpi import ScpiSupply
from eimi_drivers.supplies.scpi_profiles import GENERIC

READS_ZERO_WITHIN_A = 0.05
"""The largest current (A) that the supply may measure when no current flows.

Assumed: 0.2 % of the rated current of a BOP 36-28, which is 28 A.
"""


class KepcoBopSupply(ScpiSupply):
    """Driver of a Kepco BOP supply, whose current can be positive or negative.

    The supply is switched off by setting the current to zero; its output stays on. Two limits inside the supply are set
    and read back: the current limit (CURR:LIM), and the voltage limit (VOLT:PROT; BOP-GL 1KW manual, page B-29).
    """

    name = "kepco-bop"
    profile = replace(
        GENERIC,
        driver=name,
        set_voltage="VOLT:PROT:POS {value}",
        voltage_set="VOLT:PROT:POS?",
        protect=(*("CURR:LIM:POS {limit}", "CURR:LIM:NEG {limit}"), "VOLT:PROT:MODE FIX"),
        armed=(("CURR:LIM:POS?", "{limit}"), ("CURR:LIM:NEG?", "{limit}")),
        protections="current and voltage limits of the supply, equal to the limits of the run",
    )
    protections = profile.protections
    without_contact = STAYS_ON + armed_in_words(protections)
    voltage_limits: ClassVar[tuple[str, ...]] = ("VOLT:PROT:POS {value}", "VOLT:PROT:NEG {value}")
    """The messages that set the voltage limits in current mode."""
    bipolar = True
    current_step_A = "0.01"

    def output_on(self) -> bool:
        """Return whether the output is on and the current set-point is not zero."""
        return self._enabled() and abs(self._current_set()) > float(self.current_step_A)

    @property
    def reads_zero_within_A(self) -> float:
        """Return the largest current (A) that the supply measures when no current flows (an assumed value)."""
        return READS_ZERO_WITHIN_A

    def _enabled(self) -> bool:
        return super().output_on()

    def _protect(self) -> None:
        super()._protect()
        if not self.protections:
            return
        reply = self._line("VOLT:PROT:MODE?", self._ask("VOLT:PROT:MODE?"))
        if not reply.startswith("FIX"):  # FIX or FIXED, depending on the firmware
            raise SetPointNotTaken(
                f"{self._link.address}: the voltage limit of the supply does not follow VOLT:PROT: the answer to "
                f"VOLT:PROT:MODE? must be FIX, but it is {reply}"
            )

    def _send_voltage(self, text: str) -> None:
        self._send("FUNC:MODE CURR")
        self._send_channel(*self.voltage_limits, value=text)

    def _send_current(self, text: str) -> None:
        self._send("FUNC:MODE CURR")  # in voltage mode CURR has another meaning
        super()._send_current(text)

    def _send_output(self, on: bool) -> None:
        if on:
            super()._send_output(on)
        else:
            self._send_current("0.00")

    def _verify_output(self, on: bool) -> None:
        if on:
            super()._verify_output(on)
            return
        set_A = self._read_back(self._current_set, lambda answer: abs(answer) <= float(self.current_step_A))
        if set_A is not None:
            raise SetPointNotTaken(f"{self._link.address}: the current was set to 0 A but reads back {set_A:g} A")


class KepcoBit4886Supply(KepcoBopSupply):
    """Driver of a Kepco BOP of 50 W to 400 W with the interface card BIT 4886, in current mode.

    The card has no protections.
    """

    name = "kepco-bit4886"
    profile = replace(GENERIC, driver=name)
    protections = profile.protections
    without_contact = STAYS_ON
    voltage_limits = ("VOLT {value}",)
