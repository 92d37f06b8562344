"""Drive Kepco BOP bipolar supplies in current mode over SCPI.

Source: appendix B of the operator manuals of BOP-MG 1KW (firmware 2.01 to 4.11) and BOP-GL 1KW (firmware 3.05 and
higher), whose commands VOLT:PROT and CURR:LIM are the same. The manuals advise against ``OUTP OFF`` on inductive loads,
because then nothing controls the load's current. The output is on after power-up.

The BOP of 50 W to 400 W with the interface card BIT 4886 has none of these commands: in current mode ``CURR`` sets the
current and ``VOLT`` the limit of the voltage. Source: BIT 232F manual, page B-4, for a card with the same commands; the
page of the BIT 4886 manual (243-1303) was not at hand.
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from eimi_drivers.interfaces import SetPointNotTaken
from eimi_drivers.supplies.base import STAYS_ON, armed_in_words
from eimi_drivers.supplies.scpi import ScpiSupply
from eimi_drivers.supplies.scpi_profiles import GENERIC

READS_ZERO_WITHIN_A = 0.05
"""The largest current (A) that a meter may show when no current flows. Assumed: 0.2 % of the 28 A of a BOP 36-28."""


class KepcoBopSupply(ScpiSupply):
    """Drive a Kepco BOP, which has positive and negative currents and is switched off by setting zero.

    The output itself stays on. `output_on` therefore returns whether a current other than zero is set and the output
    is on. `set_voltage` limits the voltage of both signs (VOLT:PROT). Before the output is switched on, the supply's
    own limits of the current (CURR:LIM) are set to the driver's limit, and the voltage limit is put under the control
    of these messages (VOLT:PROT:MODE FIX; BOP-GL 1KW manual, page B-29). All are read back.
    """

    name = "kepco-bop"
    profile = replace(
        GENERIC,
        driver=name,
        set_voltage="VOLT:PROT:POS {value}",
        voltage_set="VOLT:PROT:POS?",
        protect=(*("CURR:LIM:POS {limit}", "CURR:LIM:NEG {limit}"), "VOLT:PROT:MODE FIX"),
        armed=(("CURR:LIM:POS?", "{limit}"), ("CURR:LIM:NEG?", "{limit}")),
        protections="its limits of current and voltage, equal to the limits of the run",
    )
    protections = profile.protections
    without_contact = STAYS_ON + armed_in_words(protections)
    voltage_limits: ClassVar[tuple[str, ...]] = ("VOLT:PROT:POS {value}", "VOLT:PROT:NEG {value}")
    """The messages that limit the voltage in current mode."""
    bipolar = True
    current_step_A = "0.01"

    def output_on(self) -> bool:
        """Ask whether the output is on and a current other than zero is set."""
        return self._enabled() and abs(self._current_set()) > float(self.current_step_A)

    @property
    def reads_zero_within_A(self) -> float:
        """Return `READS_ZERO_WITHIN_A`, which is assumed and was not found in a manual."""
        return READS_ZERO_WITHIN_A

    def _enabled(self) -> bool:
        return super().output_on()

    def _protect(self) -> None:
        super()._protect()
        if not self.protections:
            return
        reply = self._line("VOLT:PROT:MODE?", self._ask("VOLT:PROT:MODE?"))
        if not reply.startswith("FIX"):  # FIX or FIXED, by firmware
            raise SetPointNotTaken(
                f"{self._link.address}: its voltage limit should follow VOLT:PROT (FIX), but VOLT:PROT:MODE? is "
                f"answered {reply}"
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
    """Drive a Kepco BOP of 50 W to 400 W through its interface card BIT 4886, in current mode.

    ``VOLT`` limits the voltage of both signs there. The card has no limits of its own that could be armed.
    """

    name = "kepco-bit4886"
    profile = replace(GENERIC, driver=name)
    protections = profile.protections
    without_contact = STAYS_ON
    voltage_limits = ("VOLT {value}",)
