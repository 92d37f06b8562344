"""Emulate Keithley's supplies of the series 2200 (one channel) and 2260B.

The messages were written independently of the drivers, so that tests find a wrong message in a driver.
"""

from __future__ import annotations

from eimi_drivers.emulators.output_watchdog import OutputWatchdog
from eimi_drivers.emulators.scpi import MISSING_PARAMETER, Refused, ScpiDialect, number, switch
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.emulators.trip_level import TripLevel

OVER_VOLTAGE, SHUT_DOWN = 1, 2048
"""Bits of the questionable status register of the 2260B that report an over-voltage trip and a shut-down."""


class Keithley2200Dialect(ScpiDialect):
    """Emulated Keithley 2200, whose output timer starts when the output is switched on."""

    identification = "Keithley instruments,2200-32-3,EMULATED,1.01-1.00"

    def __init__(self, supply: CoilSupply) -> None:
        super().__init__(supply)
        self.timer = OutputWatchdog(supply, 60.0)
        ovp = TripLevel(supply, "voltage_V", 1.1 * supply.max_voltage_V, on=False)
        self.questions["VOLT:PROT?"] = lambda: f"{ovp.level:.3f}"
        self.questions["VOLT:PROT:STAT?"] = lambda: str(int(ovp.on))
        self.questions["OUTP:TIM?"] = lambda: str(int(self.timer.on))
        self.questions["OUTP:TIM:DEL?"] = lambda: f"{self.timer.seconds:.2f}"
        self.commands["VOLT:PROT"] = lambda argument: ovp.set_level(number(argument))
        self.commands["VOLT:PROT:STAT"] = lambda argument: ovp.switch(switch(argument))
        self.commands["OUTP"] = self._switch
        self.commands["OUTP:PROT:CLE"] = lambda argument: supply.clear_trip()
        self.commands["OUTP:TIM"] = lambda argument: self.timer.switch(switch(argument))
        self.commands["OUTP:TIM:DEL"] = lambda argument: self.timer.set_seconds(number(argument), 0.01, 60000.0)

    def receive(self, data: bytes) -> bytes:
        """Switch the output off if the timer has expired, then receive bytes and return the answers."""
        self.watch()
        return super().receive(data)

    def watch(self) -> None:
        """Switch the output off if the output timer has expired."""
        self.timer.watch()

    def _switch(self, argument: str) -> bool:
        on = switch(argument)
        if on and not self.supply.output_on():
            self.timer.restart()
        return self.supply.switch(on)


class Keithley2260BDialect(ScpiDialect):
    """Emulated Keithley 2260B, whose protections cannot be set below a tenth of the rated voltage or current."""

    identification = "KEITHLEY,2260B-30-72,EMULATED,01.72.20150702"

    def __init__(self, supply: CoilSupply) -> None:
        super().__init__(supply)
        ovp = TripLevel(supply, "voltage_V", 1.1 * supply.max_voltage_V, 1.1 * supply.max_voltage_V)
        ocp = TripLevel(supply, "current_A", 1.1 * supply.max_current_A, 1.1 * supply.max_current_A)
        least_V, least_A = 0.1 * supply.max_voltage_V, 0.1 * 72.0
        self.questions["VOLT:PROT?"] = lambda: f"{ovp.level:+.3f}"
        self.questions["CURR:PROT?"] = lambda: f"{ocp.level:+.3f}"
        self.questions["CURR:PROT:STAT?"] = lambda: str(int(ocp.on))
        self.questions["STAT:QUES:COND?"] = self._condition
        self.questions["MEAS:POW?"] = self.questions["MEAS:POWE?"]
        self.questions["APPL?"] = lambda: f"{supply.state.set_voltage_V:+.4f}, {supply.state.set_current_A:+.4f}"
        self.commands["VOLT:PROT"] = lambda argument: number(argument) >= least_V and ovp.set_level(number(argument))
        self.commands["CURR:PROT"] = lambda argument: number(argument) >= least_A and ocp.set_level(number(argument))
        self.commands["CURR:PROT:STAT"] = lambda argument: ocp.switch(switch(argument))
        self.commands["OUTP:PROT:CLE"] = lambda argument: supply.clear_trip()
        self.commands["APPL"] = self._apply

    def _condition(self) -> str:
        state = self.supply.state
        cause = OVER_VOLTAGE if state.set_voltage_V > state.trip_voltage_V else SHUT_DOWN
        return f"+{cause if state.tripped else 0}"

    def _apply(self, argument: str) -> bool:
        voltage, comma, current = argument.partition(",")
        if not comma:
            raise Refused(MISSING_PARAMETER)
        voltage_V, current_A = number(voltage), number(current)
        return self.supply.set_voltage(voltage_V) and self.supply.set_current(current_A)
