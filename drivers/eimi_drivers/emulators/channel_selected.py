"""Emulate SCPI supplies that have several outputs (channels), of which a message selects one.

The messages were written independently of the drivers, so that tests find a wrong message in a driver.
"""

from __future__ import annotations

import re
from typing import ClassVar

from eimi_drivers.emulators.scpi import (
    DATA_TYPE_ERROR,
    HARDWARE_MISSING,
    OUT_OF_RANGE,
    Refused,
    ScpiDialect,
    number,
    switch,
)
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.emulators.trip_level import TripLevel


class _ChannelSelected(ScpiDialect):
    """Emulated SCPI supply with several channels (outputs), whose messages apply to the channel that was selected last.

    Attributes
    ----------
    names : dict
        The name of a channel in the message INSTrument:SELect, by the number of the channel.
    aliases : dict
        The number of a channel, by another name of the channel.
    """

    names: ClassVar[dict[str, str]]
    aliases: ClassVar[dict[str, str]] = {}

    def __init__(self, supply: CoilSupply, channel: int = 1) -> None:
        super().__init__(supply, channel)
        self._selected = "2" if channel == 1 else "1"
        self.questions["INST:NSEL?"] = lambda: self._selected
        self.commands["INST:NSEL"] = self._select
        for header in ("INST", "INST:SEL"):
            self.questions[f"{header}?"] = lambda: self.names[self._selected]
            self.commands[header] = lambda argument: self._select(self._channel_named(argument))

    def _channel_named(self, name: str) -> str:
        numbers = {text: channel for channel, text in self.names.items()} | self.aliases
        if name not in numbers:
            raise Refused(DATA_TYPE_ERROR)
        return numbers[name]

    def _select(self, channel: str) -> bool:
        if channel not in self.names:
            return False
        self._selected = channel
        return True

    def _on_the_coil(self, channel: str) -> None:
        if channel != str(self.channel):
            raise Refused(HARDWARE_MISSING)

    def _parse(self, line: str) -> tuple[str, str]:
        header, argument = super()._parse(line)
        if not header.startswith(("*", "SYST:", "INST", "APPL")):
            self._on_the_coil(self._selected)
        return header, argument

    def _apply(self, voltage: str, current: str) -> bool:
        """Set the voltage (V) and the current (A), and return whether the supply accepted both.

        An empty text leaves a value unchanged.
        """
        self._on_the_coil(self._selected)
        return (not voltage or self.supply.set_voltage(number(voltage))) and (
            not current or self.supply.set_current(number(current))
        )

    def _apply_to(self, argument: str) -> bool:
        """Obey the command APPLy (set voltage and current), and return whether the supply accepted the command."""
        channel, voltage, current = [*(part.strip() for part in argument.split(",")), "", ""][:3]
        return self._select(self._channel_named(channel)) and (not voltage or self._apply(voltage, current))


class RigolDp800Dialect(_ChannelSelected):
    """Emulated Rigol DP800, in which a message can also contain the channel (``:SOURce1:``, ``CH1``).

    Source: Rigol, DP800 Programming Guide: APPLy page 2-6, OUTPut page 2-35 (first edition), over-current protection
    pages 2-56 and 2-57 (edition for the DP832A).
    """

    identification = "RIGOL TECHNOLOGIES,DP832,EMULATED,00.01.16"
    names: ClassVar[dict[str, str]] = {"1": "CH1", "2": "CH2", "3": "CH3"}
    reset_current_A = 3.0  # the default of the channels of a DP832 (page 2-6)

    def __init__(self, supply: CoilSupply, channel: int = 1) -> None:
        super().__init__(supply, channel)
        ovp = TripLevel(supply, "voltage_V", supply.max_voltage_V, 1.1 * supply.max_voltage_V, on=False)
        ocp = TripLevel(supply, "current_A", supply.max_current_A, 1.1 * supply.max_current_A, on=False)
        self.questions["OUTP?"] = lambda: "ON" if supply.output_on() else "OFF"
        self.questions["OUTP:MODE?"] = lambda: "CV" if supply.constant_voltage() else "CC"
        self._add_protection(ovp, "OUTP:OVP:VAL", "OUTP:OVP", "OUTP:OVP:QUES")
        self._add_protection(ovp, "VOLT:PROT", "VOLT:PROT:STAT", "VOLT:PROT:TRIP")
        self._add_protection(ocp, "OUTP:OCP:VAL", "OUTP:OCP", "OUTP:OCP:QUES")
        self._add_protection(ocp, "CURR:PROT", "CURR:PROT:STAT", "CURR:PROT:TRIP")
        self.questions["APPL?"] = self._applied
        self.commands["APPL"] = self._apply_to

    def _add_protection(self, protection: TripLevel, level: str, state: str, trip: str) -> None:
        self.questions[f"{level}?"] = lambda: f"{protection.level:.4f}"
        self.questions[f"{state}?"] = lambda: "ON" if protection.on else "OFF"
        self.questions[f"{trip}?"] = lambda: "YES" if self.supply.state.tripped else "NO"
        self.commands[level] = lambda argument: protection.set_level(number(argument))
        self.commands[state] = lambda argument: protection.switch(switch(argument))

    def _applied(self) -> str:
        state = self.supply.state
        return f"CH{self.channel},{state.set_voltage_V:.3f},{state.set_current_A:.4f}"

    def _answer(self, line: str) -> str | None:
        self._named = ""
        if match := re.match(r":?SOUR(?:CE)?([1-3]):", line):
            self._named, line = match[1], line[match.end() :]
        return super()._answer(line)

    def _parse(self, line: str) -> tuple[str, str]:
        header, argument = ScpiDialect._parse(self, line)
        if header in {"INST", "INST:SEL", "APPL"}:
            return header, argument
        if match := re.fullmatch(r"CH([1-3])(?:,\s*(.*))?", argument):
            self._named, argument = match[1], match[2] or ""
        if not header.startswith(("*", "SYST:", "INST")):
            self._on_the_coil(self._named or self._selected)
        return header, argument


class KeysightE3631ADialect(_ChannelSelected):
    """Emulated E3631A with the outputs 1 (+6 V), 2 (+25 V) and 3 (-25 V), which are switched on and off together.

    While tracking is on, the voltage of output 3 is the negative voltage of output 2. The ranges are not emulated.
    Source: Agilent E3631A User's Guide (E3631-90002, October 2007): APPLy page 73, selection page 74, measurements
    page 76, outputs and tracking page 77.
    """

    identification = "HEWLETT-PACKARD,E3631A,0,2.1-5.0-1.0"
    serial_line_begins_local = True  # User's Guide (E3631-90002, edition 10), page 108
    names: ClassVar[dict[str, str]] = {"1": "P6V", "2": "P25V", "3": "N25V"}

    def __init__(self, supply: CoilSupply, channel: int = 1) -> None:
        super().__init__(supply, channel)
        self._tracking = False
        self.reset_current_A = 5.0 if channel == 1 else 1.0  # table 4-1, page 72
        self.questions["OUTP:TRAC?"] = lambda: str(int(self._tracking))
        self.commands["OUTP:TRAC"] = self._track
        self.commands["APPL"] = self._apply_to
        self.commands["*RST"] = self._reset
        self.questions["APPL?"] = lambda: f'"{supply.state.set_voltage_V:.6f},{supply.state.set_current_A:.6f}"'
        for quantity in ("VOLT", "CURR"):
            for number_, name in self.names.items():
                if number_ == str(channel):
                    self.questions[f"MEAS:{quantity}? {name}"] = self.questions[f"MEAS:{quantity}?"]
        self.questions[f"APPL? {self.names[str(channel)]}"] = self.questions["APPL?"]

    def _track(self, argument: str) -> bool:
        self._tracking = switch(argument)
        return True

    def _reset(self, argument: str) -> bool:
        self._tracking = False
        return self.supply.reset(self.reset_current_A)

    def _parse(self, line: str) -> tuple[str, str]:
        header, argument = ScpiDialect._parse(self, line)
        if header.startswith(("*", "SYST:", "INST", "OUTP", "APPL")) or argument in self.names.values():
            return header, argument
        if self._tracking and self._selected == "3" and self.channel == 2 and header == "VOLT":
            if number(argument) > 0:
                raise Refused(OUT_OF_RANGE)
            return header, str(-number(argument))
        self._on_the_coil(self._selected)
        return header, argument


class RohdeSchwarzHmpDialect(_ChannelSelected):
    """Emulated R&S HMP, whose output is on only if the switch of the channel and the general switch are both on."""

    identification = "ROHDE&SCHWARZ,HMP4040,EMULATED,HW50020001/SW2.50"
    names: ClassVar[dict[str, str]] = {str(channel): f"OUTP{channel}" for channel in range(1, 5)}
    aliases: ClassVar[dict[str, str]] = {
        f"{word}{channel}": str(channel) for word in ("OUT", "OUTPUT") for channel in range(1, 5)
    }

    def __init__(self, supply: CoilSupply, channel: int = 1) -> None:
        super().__init__(supply, channel)
        self._channel_on = self._general = False
        ovp = TripLevel(supply, "voltage_V", 1.1 * supply.max_voltage_V)
        self.questions["OUTP:GEN?"] = lambda: str(int(self._general))
        self.questions["VOLT:PROT:TRIP?"] = lambda: str(int(supply.state.tripped))
        self.questions["OUTP:SEL?"] = lambda: str(int(self._channel_on))
        self.questions["APPL?"] = lambda: f"{supply.state.set_voltage_V:.3f},{supply.state.set_current_A:.4f}"
        self.questions["VOLT:STEP?"] = lambda: "1.000"
        self.questions["CURR:STEP?"] = lambda: "0.1000"
        self.questions["ARB:REP?"] = lambda: "0"
        self.questions["VOLT:PROT:LEV?"] = lambda: f"{ovp.level:.3f}"
        self.commands["VOLT:PROT:LEV"] = lambda argument: ovp.set_level(number(argument))
        self.commands["OUTP:SEL"] = self._switch_channel
        self.commands["OUTP"] = self._switch_channel
        self.commands["OUTP:GEN"] = self._switch_general
        self.commands["APPL"] = lambda argument: self._apply(*[*argument.split(","), ""][:2])

    def _switch_channel(self, argument: str) -> bool:
        self._channel_on = switch(argument)
        return self.supply.switch(self._channel_on and self._general)

    def _switch_general(self, argument: str) -> bool:
        self._general = switch(argument)
        return self.supply.switch(self._channel_on and self._general)
