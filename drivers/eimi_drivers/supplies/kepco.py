"""Kepco BOP bipolar supplies, in current mode, over SCPI.

Source: appendix B of the operator manuals of BOP-MG 1KW (firmware 2.01 to 4.11) and BOP-GL 1KW (3.05 and higher), whose
commands VOLT:PROT and CURR:LIM are the same. It advises against `OUTP OFF` on inductive loads, since
nothing then holds the load's current; and the power-up default of the output is on.
"""

from __future__ import annotations

from dataclasses import replace

from eimi_drivers.interfaces import SetPointNotTaken
from eimi_drivers.supplies.scpi import ScpiSupply
from eimi_drivers.supplies.scpi_profiles import GENERIC

READS_ZERO_WITHIN_A = 0.05
"""What the meter of a unit may show when no current flows. Assumed: 0.2 % of the 28 A of a BOP 36-28."""


class KepcoBopSupply(ScpiSupply):
    """Kepco BOP: positive and negative currents; off is a current of zero, with the output left on.

    So `output_on` says whether a current other than zero is set and let through. `set_voltage` bounds the
    voltage either way (VOLT:PROT). The supply's own software limits of the current (CURR:LIM) are set to the
    driver's before the output is switched on.
    """

    name = "kepco-bop"
    profile = replace(
        GENERIC,
        driver=name,
        set_voltage="VOLT:PROT:POS {value}",
        voltage_set="VOLT:PROT:POS?",
        protect=("CURR:LIM:POS {limit}", "CURR:LIM:NEG {limit}"),
    )
    bipolar = True
    current_step_A = "0.01"

    def output_on(self) -> bool:
        """Whether the output is on with a current other than zero set."""
        return self._enabled() and abs(self._current_set()) > float(self.current_step_A)

    @property
    def reads_zero_within_A(self) -> float:
        """Return an assumed offset of the family's meters, not checked against a manual."""
        return READS_ZERO_WITHIN_A

    def _enabled(self) -> bool:
        return super().output_on()

    def _send_voltage(self, text: str) -> None:
        self._send("FUNC:MODE CURR")
        self._send_channel("VOLT:PROT:POS {value}", "VOLT:PROT:NEG {value}", value=text)

    def _send_current(self, text: str) -> None:
        self._send("FUNC:MODE CURR")  # in voltage mode the same CURR would be the bound of another quantity
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
            raise SetPointNotTaken(f"{self._link.address}: zero was set but {set_A:g} A reads back")
