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
    all_channels: tuple[str, ...] = ("*", "SYST:")

    def _parse(self, line: str) -> tuple[str, str]:
        if line.startswith(self.all_channels):
            return super()._parse(line)
        match = re.fullmatch(r"(\S+?\?) \(@(\d)\)|(\S+) (\S+), ?\(@(\d)\)", line)
        if match is None:
            raise Refused(MISSING_PARAMETER)
        self._on_the_coil(match[2] or match[5])
        return match[1] or match[3], match[4] or ""


class KeysightN6700Dialect(KeysightE36312ADialect):
    """As above, with a watchdog for all outputs; what it has switched off still calls itself on (`OUTP?`).

    `watch` lets it act; whoever wants it to act between messages calls it then.
    """

    identification = "Keysight Technologies,N6702C,EMULATED,E.02.08"
    all_channels = ("*", "SYST:", "OUTP:PROT:WDOG")

    def __init__(self, supply: CoilSupply, channel: int = 1) -> None:
        super().__init__(supply, channel)
        self._watchdog_s, self._watching, self._programmed_on = 60.0, False, False
        self._heard_s = supply.clock.now()
        self.questions["OUTP?"] = lambda: str(int(supply.output_on() or self._programmed_on))
        self.questions["STAT:QUES:COND?"] = lambda: str(2048 if supply.state.tripped else 0)
        self.questions["OUTP:PROT:WDOG?"] = lambda: str(int(self._watching))
        self.questions["OUTP:PROT:WDOG:DEL?"] = lambda: f"{self._watchdog_s:.0f}"
        self.commands["OUTP"] = self._switch
        self.commands["OUTP:PROT:CLE"] = self._clear
        self.commands["OUTP:PROT:WDOG"] = self._arm_watchdog
        self.commands["OUTP:PROT:WDOG:DEL"] = self._set_watchdog
        self.commands["CURR:PROT:STAT"] = lambda argument: not switch(argument)
        self.commands["VOLT:PROT"] = lambda argument: supply.set_trip_levels(voltage_V=number(argument))

    def receive(self, data: bytes) -> bytes:
        """Every message holds the watchdog off."""
        self.watch()
        self._heard_s = self.supply.clock.now()
        return super().receive(data)

    def watch(self) -> None:
        """Switch off where nobody was heard for too long."""
        if self._watching and self.supply.output_on() and self.supply.clock.now() - self._heard_s > self._watchdog_s:
            self._programmed_on = True
            self.supply.trip()

    def _parse(self, line: str) -> tuple[str, str]:
        if match := re.fullmatch(r"(OUTP:PROT:CLE) \(@(\d)\)", line):
            self._on_the_coil(match[2])
            return match[1], ""
        return super()._parse(line)

    def _switch(self, argument: str) -> bool:
        if self.supply.state.tripped:
            self._programmed_on = switch(argument)
            return True
        return self.supply.switch(switch(argument))

    def _clear(self, argument: str) -> bool:
        on, self._programmed_on = self._programmed_on, False
        return self.supply.clear_trip() and (not on or self.supply.switch(True))

    def _arm_watchdog(self, argument: str) -> bool:
        self._watching = switch(argument)
        return True

    def _set_watchdog(self, argument: str) -> bool:
        self._watchdog_s = number(argument)
        return 1 <= self._watchdog_s <= 3600


class KeysightE364xDialect(ScpiDialect):
    """Over-voltage protection with a level; over-current protection there is none."""

    identification = "Agilent Technologies,E3640A,0,1.7-5.0-1.0"

    def __init__(self, supply: CoilSupply) -> None:
        super().__init__(supply)
        self._ovp_V = 1.1 * supply.max_voltage_V
        self._ovp = True
        supply.set_trip_levels(voltage_V=self._ovp_V)
        self.questions["VOLT:PROT?"] = lambda: f"{self._ovp_V:.6E}"
        self.questions["VOLT:PROT:STAT?"] = lambda: str(int(self._ovp))
        self.questions["VOLT:PROT:TRIP?"] = lambda: str(int(supply.state.tripped))
        self.commands["VOLT:PROT:CLE"] = lambda argument: supply.clear_trip()
        self.commands["VOLT:PROT"] = lambda argument: self._set_ovp(number(argument), self._ovp)
        self.commands["VOLT:PROT:STAT"] = lambda argument: self._set_ovp(self._ovp_V, switch(argument))

    def _set_ovp(self, level_V: float, on: bool) -> bool:
        if not 0 < level_V <= 1.1 * self.supply.max_voltage_V:
            return False
        self._ovp_V, self._ovp = level_V, on
        return self.supply.set_trip_levels(voltage_V=level_V if on else float("inf"))


class KeysightE3632ADialect(KeysightE364xDialect):
    """The same, and over-current protection with a level, too."""

    identification = "HEWLETT-PACKARD,E3632A,0,1.1-5.0-1.0"

    def __init__(self, supply: CoilSupply) -> None:
        super().__init__(supply)
        self._ocp_A = 1.1 * supply.max_current_A
        self._ocp = True
        supply.set_trip_levels(current_A=self._ocp_A)
        self.questions["CURR:PROT?"] = lambda: f"{self._ocp_A:.6E}"
        self.questions["CURR:PROT:STAT?"] = lambda: str(int(self._ocp))
        self.questions["CURR:PROT:TRIP?"] = lambda: str(int(supply.state.tripped))
        self.commands["CURR:PROT:CLE"] = lambda argument: supply.clear_trip()
        self.commands["CURR:PROT"] = lambda argument: self._set_ocp(number(argument), self._ocp)
        self.commands["CURR:PROT:STAT"] = lambda argument: self._set_ocp(self._ocp_A, switch(argument))

    def _set_ocp(self, level_A: float, on: bool) -> bool:
        if not 0 < level_A <= 1.1 * self.supply.max_current_A:
            return False
        self._ocp_A, self._ocp = level_A, on
        return self.supply.set_trip_levels(current_A=level_A if on else float("inf"))


class _ChannelSelected(_SeveralChannels):
    """One channel at a time is selected; messages go to that one. Another than the coil's is selected at first."""

    channels = frozenset({"1", "2", "3"})

    def __init__(self, supply: CoilSupply, channel: int = 1) -> None:
        super().__init__(supply, channel)
        self._selected = "2" if channel == 1 else "1"
        self.questions["INST:NSEL?"] = lambda: self._selected
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
        self.questions["OUTP:OVP:VAL?"] = lambda: f"{supply.state.trip_voltage_V:.4f}"
        self.questions["OUTP:OCP:VAL?"] = lambda: f"{self._ocp_A:.4f}"
        self.questions["OUTP:OCP:STAT?"] = lambda: "OFF" if supply.state.trip_current_A == float("inf") else "ON"
        self.commands["OUTP:OVP:VAL"] = lambda argument: supply.set_trip_levels(voltage_V=number(argument))
        self.commands["OUTP:OCP:VAL"] = self._set_ocp
        self.commands["OUTP:OCP:STAT"] = lambda argument: supply.set_trip_levels(
            current_A=self._ocp_A if switch(argument) else float("inf")
        )

    def _set_ocp(self, argument: str) -> bool:
        self._ocp_A = number(argument)
        return self._ocp_A > 0


class SiglentSpdDialect(_SeveralChannels):
    """Channels are named in the header or in the argument; the output shows in a hexadecimal status word."""

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


class RohdeSchwarzHmpDialect(_ChannelSelected):
    """A channel feeds its output when it is on and the general switch is, too."""

    identification = "ROHDE&SCHWARZ,HMP4040,EMULATED,HW50020001/SW2.50"
    channels = frozenset({"1", "2", "3", "4"})

    def __init__(self, supply: CoilSupply, channel: int = 1) -> None:
        super().__init__(supply, channel)
        self._channel_on = self._general = False
        self.questions["OUTP:GEN?"] = lambda: str(int(self._general))
        self.questions["VOLT:PROT:TRIP?"] = lambda: str(int(supply.state.tripped))
        self.questions["OUTP:SEL?"] = lambda: str(int(self._channel_on))
        self.questions["APPL?"] = lambda: f"{supply.state.set_voltage_V:.3f},{supply.state.set_current_A:.4f}"
        self.questions["VOLT:STEP?"] = lambda: "1.000"
        self.questions["CURR:STEP?"] = lambda: "0.1000"
        self.questions["ARB:REP?"] = lambda: "0"
        self.commands["OUTP:SEL"] = self._switch_channel
        self.questions["VOLT:PROT:LEV?"] = lambda: f"{supply.state.trip_voltage_V:.3f}"
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
        del self.commands["VOLT"]
        self.questions["VOLT?"] = lambda: "0.000E+00"  # of voltage mode, which no coil is driven in
        self.questions["DIAG:TST?"] = lambda: "0"
        self.commands["SYST:BEEP"] = lambda argument: True
        self.questions["FUNC:MODE?"] = lambda: {"VOLT": "0", "CURR": "1"}[self._mode]
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
