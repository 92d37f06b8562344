"""The language of TDK-Lambda Genesys on the emulated supply."""

from __future__ import annotations

from eimi_drivers.emulators.supply import CoilSupply

OUT_OF_RANGE = "E01"
ILLEGAL_COMMAND = "C01"
ILLEGAL_PARAMETER = "C03"


class GenesysDialect:
    """Answers as one unit on a serial line does: silent until it is addressed, deaf to setters until remote.

    Where the front panel is locked, setters are answered `OK` and not obeyed.
    """

    identification = "LAMBDA,GEN40-38"

    def __init__(self, supply: CoilSupply, unit: int = 6) -> None:
        self.supply = supply
        self.unit = unit
        self._addressed = False
        self._remote = False
        self._unfinished = b""

    def receive(self, data: bytes) -> bytes:
        """Take bytes, return the answers to the lines that they complete."""
        *lines, self._unfinished = (self._unfinished + data).split(b"\r")
        answers = (self._answer(line.decode("latin-1").strip()) for line in lines)
        return b"".join(answer.encode("ascii") + b"\r" for answer in answers if answer)

    def _answer(self, line: str) -> str:
        header, _, argument = line.partition(" ")
        if header == "ADR":
            self._addressed = argument == str(self.unit)
            return "OK" if self._addressed else ""
        if not self._addressed:
            return ""
        return self._tell(header) if header.endswith("?") else self._obey(header, argument)

    def _tell(self, question: str) -> str:
        supply = self.supply
        state = supply.state
        match question:
            case "IDN?":
                return self.identification
            case "OUT?":
                return "ON" if supply.output_on() else "OFF"
            case "MODE?":
                return "OFF" if not supply.output_on() else "CV" if supply.constant_voltage() else "CC"
            case "PV?":
                return f"{state.set_voltage_V:06.3f}"
            case "PC?":
                return f"{state.set_current_A:06.3f}"
            case "MV?":
                return f"{max(supply.read().voltage_V, 0.0):06.3f}"
            case "MC?":
                return f"{max(supply.read().current_A, 0.0):06.3f}"
            case "STT?":
                return self._status()
        return ILLEGAL_COMMAND

    def _status(self) -> str:
        on, reading = self.supply.output_on(), self.supply.read()
        faults = (0x10 if self.supply.state.tripped else 0) | (0 if on else 0x40)
        status = 0x01 if self.supply.constant_voltage() else 0x02
        state = self.supply.state
        return (
            f"MV({max(reading.voltage_V, 0):06.3f}),PV({state.set_voltage_V:06.3f}),"
            f"MC({max(reading.current_A, 0):06.3f}),PC({state.set_current_A:06.3f}),SR({status:02X}),FR({faults:02X})"
        )

    def _obey(self, header: str, argument: str) -> str:
        if header == "RMT":
            self._remote = argument in {"REM", "LLO"}
            return "OK"
        if not self._remote:
            return ILLEGAL_COMMAND
        supply = self.supply
        match header, argument:
            case "OUT", "ON" | "OFF":
                taken = supply.switch(argument == "ON")
            case "FLD", "ON" | "OFF":
                taken = supply.arm(argument == "ON")
            case "PV" | "PC" | "OVP", _:
                try:
                    value = float(argument)
                except ValueError:
                    return ILLEGAL_PARAMETER
                taken = self._set(header, value)
            case _:
                return ILLEGAL_COMMAND
        return "OK" if taken or supply.locked else OUT_OF_RANGE

    def _set(self, header: str, value: float) -> bool:
        if header == "PV":
            return self.supply.set_voltage(value)
        if header == "PC":
            return self.supply.set_current(value)
        return value > 0 and self.supply.set_trip_levels(voltage_V=value)
