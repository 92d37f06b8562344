"""Emulate the command language of Owon SPE supplies."""

from __future__ import annotations

from eimi_drivers.emulators.scpi import Refused, ScpiDialect, number
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.emulators.trip_level import TripLevel

STANDBY, CONSTANT_VOLTAGE, CONSTANT_CURRENT, FAILURE = range(4)


class OwonSpeDialect(ScpiDialect):
    """Emulated Owon SPE, which has no error queue and answers ERR to a message that it does not understand."""

    identification = "OWON,SPE6103,EMULATED,FV:V3.0.0"

    def __init__(self, supply: CoilSupply) -> None:
        super().__init__(supply)
        ovp = TripLevel(supply, "voltage_V", supply.max_voltage_V + 1.0, supply.max_voltage_V + 1.0)
        ocp = TripLevel(supply, "current_A", supply.max_current_A + 0.1, supply.max_current_A + 0.1)
        del self.questions["SYST:ERR?"]
        self.questions |= {
            "VOLT?": lambda: f"{supply.state.set_voltage_V:.3f}",
            "CURR?": lambda: f"{supply.state.set_current_A:.3f}",
            "MEAS:VOLT?": lambda: f"{supply.read().voltage_V:.3f}",
            "MEAS:CURR?": lambda: f"{supply.read().current_A:.3f}",
            "OUTP?": lambda: "ON" if supply.output_on() else "OFF",
            "VOLT:LIM?": lambda: f"{ovp.level:.3f}",
            "CURR:LIM?": lambda: f"{ocp.level:.3f}",
            "MEAS:ALL:INFO?": self._state,
        }
        self.commands["VOLT:LIM"] = lambda argument: ovp.set_level(number(argument))
        self.commands["CURR:LIM"] = lambda argument: ocp.set_level(number(argument))

    def _state(self) -> str:
        supply = self.supply
        on, reading, state = supply.output_on(), supply.read(), supply.state
        over_voltage = state.tripped and abs(state.set_voltage_V) > state.trip_voltage_V
        mode = FAILURE if state.tripped else CONSTANT_VOLTAGE if supply.constant_voltage() else CONSTANT_CURRENT
        words = {True: "ON", False: "OFF"}
        flags = f"{words[over_voltage]},{words[state.tripped and not over_voltage]},OFF"
        power_W = reading.voltage_V * reading.current_A
        mode = mode if on or state.tripped else STANDBY
        return f"{reading.voltage_V:.3f},{reading.current_A:.3f},{power_W:.3f},{flags},{mode}"

    def _answer(self, line: str) -> str | None:
        answer = super()._answer(line)
        if self._errors:
            self._errors.clear()
            return "ERR"
        return answer

    def _parse(self, line: str) -> tuple[str, str]:
        if line.startswith("SYST:ERR"):
            raise Refused("ERR")
        return super()._parse(line)
