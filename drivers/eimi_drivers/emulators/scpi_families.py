"""What sets families of SCPI supplies apart, written down once more and independently of the drivers' profiles.

A message for another channel than the coil's is answered with an error.
"""

from __future__ import annotations

import re

from eimi_drivers.emulators.scpi import DATA_TYPE_ERROR, HARDWARE_MISSING, Refused, ScpiDialect, number, switch
from eimi_drivers.emulators.supply import CoilSupply

SETTINGS_CONFLICT = '-221,"Settings conflict"'
MISSING_PARAMETER = '-109,"Missing parameter"'


class _SeveralChannels(ScpiDialect):
    """A supply with channels, the coil on one of them."""

    def _on_the_coil(self, channel: str) -> None:
        if channel != str(self.channel):
            raise Refused(HARDWARE_MISSING)


class KeysightE36312ADialect(_SeveralChannels):
    """Channels are named in each message by a list, `(@1)`."""

    identification = "Keysight Technologies,E36312A,EMULATED,1.0"

    def _parse(self, line: str) -> tuple[str, str]:
        if line.startswith(("*", "SYST:")):
            return super()._parse(line)
        match = re.fullmatch(r"(\S+?\?) \(@(\d)\)|(\S+) (\S+), ?\(@(\d)\)", line)
        if match is None:
            raise Refused(MISSING_PARAMETER)
        self._on_the_coil(match[2] or match[5])
        return match[1] or match[3], match[4] or ""


class KeysightE364xDialect(ScpiDialect):
    """One channel with over-current protection, whose level stays at the supply's largest current."""

    identification = "Agilent Technologies,E3632A,0,1.1-5.0-1.0"

    def __init__(self, supply: CoilSupply) -> None:
        super().__init__(supply)
        self.questions["CURR:PROT:TRIP?"] = lambda: str(int(supply.state.tripped))
        self.commands["CURR:PROT:CLE"] = lambda argument: supply.clear_trip()
        self.commands["CURR:PROT:STAT"] = lambda argument: supply.set_trip_levels(
            current_A=supply.max_current_A if switch(argument) else float("inf")
        )


class _ChannelSelected(_SeveralChannels):
    """One channel at a time is selected; messages go to that one. Another than the coil's is selected at first."""

    channels = frozenset({"1", "2", "3"})

    def __init__(self, supply: CoilSupply, channel: int = 1) -> None:
        super().__init__(supply, channel)
        self._selected = "2" if channel == 1 else "1"
        self.commands["INST:NSEL"] = self._select

    def _select(self, argument: str) -> bool:
        self._selected = argument
        return argument in self.channels

    def _parse(self, line: str) -> tuple[str, str]:
        header, argument = super()._parse(line)
        if not header.startswith(("*", "SYST:", "INST:")):
            self._on_the_coil(self._selected)
        return header, argument


class RigolDp800Dialect(_ChannelSelected):
    """Headers begin with a colon; over-voltage and over-current protection with levels of their own."""

    identification = "RIGOL TECHNOLOGIES,DP832,EMULATED,00.01.16"

    def __init__(self, supply: CoilSupply, channel: int = 1) -> None:
        super().__init__(supply, channel)
        self._ocp_A = supply.max_current_A
        self.questions["OUTP?"] = lambda: "ON" if supply.output_on() else "OFF"
        self.questions["OUTP:MODE?"] = lambda: "CV" if supply.constant_voltage() else "CC"
        self.questions["OUTP:OCP:QUES?"] = lambda: "YES" if supply.state.tripped else "NO"
        self.commands["OUTP:OVP:VAL"] = lambda argument: supply.set_trip_levels(voltage_V=number(argument))
        self.commands["OUTP:OCP:VAL"] = self._set_ocp
        self.commands["OUTP:OCP:STAT"] = lambda argument: supply.set_trip_levels(
            current_A=self._ocp_A if switch(argument) else float("inf")
        )

    def _set_ocp(self, argument: str) -> bool:
        self._ocp_A = number(argument)
        return self._ocp_A > 0

    def _parse(self, line: str) -> tuple[str, str]:
        return super()._parse(line.removeprefix(":").removeprefix("SOUR:"))


class SiglentSpdDialect(_SeveralChannels):
    """Channels are named in the header or in the argument; the output shows in a hexadecimal status word."""

    identification = "Siglent Technologies,SPD3303X,EMULATED,1.01.01.02.05,V3.0"
    no_error = "0  No Error"

    def __init__(self, supply: CoilSupply, channel: int = 1) -> None:
        super().__init__(supply, channel)
        del self.questions["OUTP?"]
        self.questions["SYST:STAT?"] = self._status

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
        if not header.startswith(("*", "SYST:")):
            raise Refused(MISSING_PARAMETER)
        return header, argument


class RohdeSchwarzHmpDialect(_ChannelSelected):
    """A channel feeds its output when it is on and the general switch is, too."""

    identification = "ROHDE&SCHWARZ,HMP4040,EMULATED,HW50020001/SW2.50"
    channels = frozenset({"1", "2", "3", "4"})

    def __init__(self, supply: CoilSupply, channel: int = 1) -> None:
        super().__init__(supply, channel)
        self._channel_on = self._general = False
        self.questions["OUTP:GEN?"] = lambda: str(int(self._general))
        self.questions["VOLT:PROT:TRIP?"] = lambda: str(int(supply.state.tripped))
        self.commands["OUTP"] = self._switch_channel
        self.commands["OUTP:GEN"] = self._switch_general
        self.commands["VOLT:PROT:LEV"] = lambda argument: supply.set_trip_levels(voltage_V=number(argument))

    def _switch_channel(self, argument: str) -> bool:
        self._channel_on = switch(argument)
        return self.supply.switch(self._channel_on and self._general)

    def _switch_general(self, argument: str) -> bool:
        self._general = switch(argument)
        return self.supply.switch(self._channel_on and self._general)


class KepcoBopDialect(ScpiDialect):
    """Bipolar, in voltage mode and with its output on when it is switched on, as the real one is."""

    identification = "KEPCO,BOP 1KW 36-28,EMULATED,2.38"

    def __init__(self, supply: CoilSupply) -> None:
        super().__init__(supply)
        supply.bipolar = True
        supply.switch(True)
        self._mode = "VOLT"
        self._limits_A = {"POS": supply.max_current_A, "NEG": supply.max_current_A}
        self._bounds_V = {"POS": supply.max_voltage_V, "NEG": supply.max_voltage_V}
        del self.commands["VOLT"], self.questions["VOLT?"]
        self.commands["FUNC:MODE"] = self._set_mode
        self.commands["CURR"] = self._set_current
        for side in ("POS", "NEG"):
            self.commands[f"CURR:LIM:{side}"] = lambda argument, side=side: self._set_limit(side, argument)  # type: ignore[misc]
            self.commands[f"VOLT:PROT:{side}"] = lambda argument, side=side: self._set_bound(side, argument)  # type: ignore[misc]
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

    def _set_limit(self, side: str, argument: str) -> bool:
        self._limits_A[side] = number(argument)
        return 0 <= self._limits_A[side] <= self.supply.max_current_A

    def _set_bound(self, side: str, argument: str) -> bool:
        bounds_V = self._bounds_V | {side: number(argument)}
        taken = bounds_V[side] >= 0 and self.supply.set_voltage(min(bounds_V.values()))
        if taken:
            self._bounds_V = bounds_V
        return taken
