"""Emulate Keysight's power systems N6700, N6900 and RP7900, which have a watchdog for their outputs.

The messages were written independently of the drivers, so that tests find a wrong message in a driver.
"""

from __future__ import annotations

import re

from eimi_drivers.emulators.output_watchdog import OutputWatchdog
from eimi_drivers.emulators.scpi import DATA_TYPE_ERROR, Refused, ScpiDialect, number, switch
from eimi_drivers.emulators.scpi_families import KeysightE36312ADialect
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.emulators.trip_level import TripLevel

PROTECTED = 2048
"""The bit of the questionable status register that is set after the watchdog has switched the output off."""


class _KeysightWatchdog(ScpiDialect):
    """Emulated Keysight supply with a watchdog, a timer that switches the output off unless messages restart it."""

    status = "STAT:QUES1:COND?"

    def __init__(self, supply: CoilSupply, channel: int = 1) -> None:
        super().__init__(supply, channel)
        self.watchdog = OutputWatchdog(supply, 60.0)
        self._programmed_on = False
        self.questions["OUTP?"] = lambda: str(int(supply.output_on() or self._programmed_on))
        self.questions[self.status] = lambda: str(PROTECTED if supply.state.tripped else 0)
        self.questions["OUTP:PROT:WDOG?"] = lambda: str(int(self.watchdog.on))
        self.questions["OUTP:PROT:WDOG:DEL?"] = lambda: f"{self.watchdog.seconds:.0f}"
        self.commands["OUTP"] = self._switch
        self.commands["OUTP:PROT:CLE"] = self._clear
        self.commands["OUTP:PROT:WDOG"] = lambda argument: self.watchdog.switch(switch(argument))
        self.commands["OUTP:PROT:WDOG:DEL"] = lambda argument: self.watchdog.set_seconds(number(argument), 1, 3600)

    def receive(self, data: bytes) -> bytes:
        """Receive bytes, restart the watchdog (a timer that switches the output off), and return the answers."""
        self.watch()
        self.watchdog.restart()
        return super().receive(data)

    def watch(self) -> None:
        """Switch the output off if the watchdog (a timer that every message restarts) has expired."""
        if self.watchdog.watch():
            self._programmed_on = True

    def _switch(self, argument: str) -> bool:
        if self.supply.state.tripped:
            self._programmed_on = switch(argument)
            return True
        return self.supply.switch(switch(argument))

    def _clear(self, argument: str) -> bool:
        on, self._programmed_on = self._programmed_on, False
        return self.supply.clear_trip() and (not on or self.supply.switch(True))


class KeysightN6700Dialect(_KeysightWatchdog, KeysightE36312ADialect):
    """Emulated Keysight N6700, in which each message for an output contains the channel."""

    identification = "Keysight Technologies,N6702C,EMULATED,E.02.08"
    all_channels = ("*", "SYST:", "OUTP:PROT:WDOG")
    status = "STAT:QUES:COND?"

    def _parse(self, line: str) -> tuple[str, str]:
        if match := re.fullmatch(r"(OUTP:PROT:CLE) \(@(\d)\)", line):
            self._on_the_coil(match[2])
            return match[1], ""
        return super()._parse(line)


class KeysightN6900Dialect(_KeysightWatchdog):
    """Emulated Keysight N6900, which has one output.

    After power-up the supply regulates the voltage, and the current set-point has no effect on the current in the coil.
    """

    identification = "Keysight Technologies,N6971A,EMULATED,B.01.01"

    def __init__(self, supply: CoilSupply) -> None:
        super().__init__(supply)
        ovp = TripLevel(supply, "voltage_V", 1.2 * supply.max_voltage_V)
        self._priority, self._over_current = "VOLT", False
        self.questions["FUNC?"] = lambda: self._priority
        self.questions["VOLT:LIM?"] = self.questions["VOLT?"]
        self.questions["STAT:QUES2:COND?"] = lambda: "0"
        self.questions["VOLT:PROT?"] = lambda: f"{ovp.level:.6E}"
        self.questions["CURR:PROT:STAT?"] = lambda: str(int(self._over_current))
        self.commands["FUNC"] = self._set_priority
        self.commands["VOLT:LIM"] = lambda argument: supply.set_voltage(number(argument))
        self.commands["VOLT"] = lambda argument: number(argument) >= 0
        self.commands["CURR"] = self._set_current
        self.commands["VOLT:PROT"] = lambda argument: ovp.set_level(number(argument))
        self.commands["CURR:PROT:STAT"] = self._switch_over_current

    def _set_priority(self, argument: str) -> bool:
        priority = argument[:4]
        if priority not in {"VOLT", "CURR"}:
            raise Refused(DATA_TYPE_ERROR)
        if priority != self._priority:
            self._priority = priority
            return self.supply.reset()
        return True

    def _set_current(self, argument: str) -> bool:
        current_A = number(argument)
        return self._priority == "VOLT" or self.supply.set_current(current_A)

    def _switch_over_current(self, argument: str) -> bool:
        self._over_current = switch(argument)
        return self.supply.arm(self._over_current)


class KeysightRp7900Dialect(KeysightN6900Dialect):
    """Emulated Keysight RP7900, which gives the answers of an N6900."""

    identification = "Keysight Technologies,RP7931A,EMULATED,B.04.06"
