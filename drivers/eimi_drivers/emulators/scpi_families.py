"""Emulate SCPI supplies that have one output (channel) or expect the channel in each message.

The messages were written independently of the drivers, so that tests find a wrong message in a driver.
"""

from __future__ import annotations

import re

from eimi_drivers.emulators.scpi import (
    DATA_TYPE_ERROR,
    HARDWARE_MISSING,
    MISSING_PARAMETER,
    Refused,
    ScpiDialect,
    number,
    switch,
)
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.emulators.trip_level import TripLevel

SETTINGS_CONFLICT = '-221,"Settings conflict"'


class _SeveralChannels(ScpiDialect):
    """Emulated SCPI supply with several outputs (channels), of which one feeds the coil."""

    def _on_the_coil(self, channel: str) -> None:
        if channel != str(self.channel):
            raise Refused(HARDWARE_MISSING)


class KeysightE36312ADialect(_SeveralChannels):
    """Emulated E36312A, in which each message for an output contains a list of channels such as ``(@1)``."""

    identification = "Keysight Technologies,E36312A,EMULATED,1.0"
    all_channels: tuple[str, ...] = ("*", "SYST:")

    def __init__(self, supply: CoilSupply, channel: int = 1) -> None:
        super().__init__(supply, channel)
        ovp = TripLevel(supply, "voltage_V", 1.1 * supply.max_voltage_V)
        self._over_current = False
        self.questions["VOLT:PROT?"] = lambda: f"{ovp.level:.6E}"
        self.questions["VOLT:PROT:TRIP?"] = lambda: str(int(supply.state.tripped))
        self.questions["CURR:PROT:STAT?"] = lambda: str(int(self._over_current))
        self.commands["VOLT:PROT"] = lambda argument: ovp.set_level(number(argument))
        self.commands["CURR:PROT:STAT"] = self._switch_over_current

    def _switch_over_current(self, argument: str) -> bool:
        if not self.supply.arm(switch(argument)):
            return False
        self._over_current = switch(argument)
        return True

    def _parse(self, line: str) -> tuple[str, str]:
        if line.startswith(self.all_channels):
            return super()._parse(line)
        match = re.fullmatch(r"(\S+?\?) \(@(\d)\)|(\S+) (\S+), ?\(@(\d)\)", line)
        if match is None:
            raise Refused(MISSING_PARAMETER)
        self._on_the_coil(match[2] or match[5])
        return match[1] or match[3], match[4] or ""


class KeysightE364xDialect(ScpiDialect):
    """Emulated E364x, which has an over-voltage protection with a trip level (V), and no over-current protection."""

    identification = "Agilent Technologies,E3640A,0,1.7-5.0-1.0"
    serial_line_begins_local = True  # assumed to be as on the E3631A

    def __init__(self, supply: CoilSupply) -> None:
        super().__init__(supply)
        highest_V = 1.1 * supply.max_voltage_V
        self._add_protection("VOLT", TripLevel(supply, "voltage_V", highest_V, highest_V))

    def _add_protection(self, word: str, protection: TripLevel) -> None:
        header = f"{word}:PROT"
        self.questions[f"{header}?"] = lambda: f"{protection.level:.6E}"
        self.questions[f"{header}:STAT?"] = lambda: str(int(protection.on))
        self.questions[f"{header}:TRIP?"] = lambda: str(int(self.supply.state.tripped))
        self.commands[f"{header}:CLE"] = lambda argument: self.supply.clear_trip()
        self.commands[header] = lambda argument: protection.set_level(number(argument))
        self.commands[f"{header}:STAT"] = lambda argument: protection.switch(switch(argument))


class KeysightE3632ADialect(KeysightE364xDialect):
    """Emulated E3632A, which has an over-voltage and an over-current protection, each with a trip level (V or A)."""

    identification = "HEWLETT-PACKARD,E3632A,0,1.1-5.0-1.0"

    def __init__(self, supply: CoilSupply) -> None:
        super().__init__(supply)
        highest_A = 1.1 * supply.max_current_A
        self._add_protection("CURR", TripLevel(supply, "current_A", highest_A, highest_A))


class SiglentSpdDialect(_SeveralChannels):
    """Emulated Siglent SPD, whose messages contain the channel."""

    identification = "Siglent Technologies,SPD3303X,EMULATED,1.01.01.02.05,V3.0"
    no_error = "0  No Error"

    def __init__(self, supply: CoilSupply, channel: int = 1) -> None:
        super().__init__(supply, channel)
        del self.questions["OUTP?"]
        self.questions["SYST:STAT?"] = self._status
        self.questions["INST?"] = lambda: f"CH{self.channel}"

    def _status(self) -> str:
        independent = 0x04
        output = 0x10 if self.supply.output_on() else 0
        constant_current = 0 if self.supply.constant_voltage() else 0x01
        return hex(independent | (output | constant_current) << self.channel - 1)

    def _parse(self, line: str) -> tuple[str, str]:
        header, argument = super()._parse(line)
        if match := re.fullmatch(r"CH(\d):(VOLT\??|CURR\??)", header):
            self._on_the_coil(match[1])
            return match[2], argument
        if match := re.fullmatch(r"CH(\d)(?:,(ON|OFF))?", argument):
            self._on_the_coil(match[1])
            return header, match[2] or ""
        if not header.startswith(("*", "SYST:", "INST")):
            raise Refused(MISSING_PARAMETER)
        return header, argument


class KepcoBopDialect(ScpiDialect):
    """Emulated Kepco BOP, a supply for positive and negative currents."""

    identification = "KEPCO,BOP 1KW 36-28,EMULATED,2.38"

    def __init__(self, supply: CoilSupply) -> None:
        super().__init__(supply)
        supply.bipolar = True
        supply.switch(True)
        self._mode = "VOLT"
        self._limits_A = {"POS": supply.max_current_A, "NEG": supply.max_current_A}
        self._bounds_V = {"POS": supply.max_voltage_V, "NEG": supply.max_voltage_V}
        del self.commands["VOLT"]
        self.questions["VOLT?"] = lambda: "0.000E+00"  # set-point of voltage mode, which has no effect on the coil
        self.questions["DIAG:TST?"] = lambda: "0"
        self.questions["FUNC:MODE?"] = lambda: {"VOLT": "0", "CURR": "1"}[self._mode]
        self.commands["FUNC:MODE"] = self._set_mode
        self.commands["CURR"] = self._set_current
        self._protect_mode = "EXT"  # the analog port controls the limits until a message sets FIX
        self.questions["VOLT:PROT:MODE?"] = lambda: self._protect_mode
        self.commands["VOLT:PROT:MODE"] = self._set_protect_mode
        for side in ("POS", "NEG"):
            self.commands[f"CURR:LIM:{side}"] = lambda argument, side=side: self._set_limit(side, argument)  # type: ignore[misc]
            self.commands[f"VOLT:PROT:{side}"] = lambda argument, side=side: self._set_bound(side, argument)  # type: ignore[misc]
            self.questions[f"CURR:LIM:{side}?"] = lambda side=side: f"{self._limits_A[side]:.3E}"  # type: ignore[misc]
            self.questions[f"VOLT:PROT:{side}?"] = lambda side=side: f"{self._bounds_V[side]:.3E}"  # type: ignore[misc]

    def _set_mode(self, argument: str) -> bool:
        if argument not in {"VOLT", "CURR"}:
            raise Refused(DATA_TYPE_ERROR)
        self._mode = argument
        return True

    def _set_current(self, argument: str) -> bool:
        current_A = number(argument)
        if self._mode != "CURR":
            raise Refused(SETTINGS_CONFLICT)
        return -self._limits_A["NEG"] <= current_A <= self._limits_A["POS"] and self.supply.set_current(current_A)

    def _set_protect_mode(self, argument: str) -> bool:
        if argument not in {"EXT", "FIX", "LESS"}:
            raise Refused(DATA_TYPE_ERROR)
        self._protect_mode = argument
        return True

    def _set_limit(self, side: str, argument: str) -> bool:
        limit_A = number(argument)
        if not 0 <= limit_A <= self.supply.max_current_A:
            return False
        self._limits_A[side] = limit_A
        return True

    def _set_bound(self, side: str, argument: str) -> bool:
        bounds_V = self._bounds_V | {side: number(argument)}
        accepted = bounds_V[side] >= 0 and self.supply.set_voltage(min(bounds_V.values()))
        if accepted:
            self._bounds_V = bounds_V
        return accepted


class KepcoBit4886Dialect(ScpiDialect):
    """Emulated Kepco BOP of 50 W to 400 W with the interface card BIT 4886."""

    identification = "KEPCO,BIT 4886,EMULATED,2.3"

    def __init__(self, supply: CoilSupply) -> None:
        super().__init__(supply)
        supply.bipolar = True
        supply.switch(True)
        self._mode = "VOLT"
        self.questions["FUNC:MODE?"] = lambda: {"VOLT": "0", "CURR": "1"}[self._mode]
        self.commands["FUNC:MODE"] = self._set_mode
        self.commands["VOLT"] = lambda argument: self._mode == "VOLT" or supply.set_voltage(number(argument))
        self.commands["CURR"] = self._set_current

    def _set_mode(self, argument: str) -> bool:
        if argument not in {"VOLT", "CURR"}:
            raise Refused(DATA_TYPE_ERROR)
        self._mode = argument
        return True

    def _set_current(self, argument: str) -> bool:
        if self._mode == "VOLT":
            return number(argument) >= 0
        return self.supply.set_current(number(argument))
