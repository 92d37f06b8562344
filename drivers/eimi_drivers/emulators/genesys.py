"""Emulate the command language of TDK-Lambda Genesys supplies."""

from __future__ import annotations

from eimi_drivers.emulators.supply import CoilSupply

ABOVE_RANGE = "E01"
BELOW_UVL = "E02"
OVP_TOO_LOW = "E04"
UVL_TOO_HIGH = "E06"
OUT_OF_RANGE = "C05"
ILLEGAL_COMMAND = "C01"
ILLEGAL_PARAMETER = "C03"

_FIXED = {
    "REV?": "1U1K5:4.3",
    "DATE?": "2020/01/01",
    "AST?": "OFF",
    "FILTER?": "18",
    "FBD?": "0",
    "MS?": "1",
    "MDAV?": "0",
}


class GenesysDialect:
    """Emulated TDK-Lambda Genesys, one of several supplies on a serial line.

    Parameters
    ----------
    supply : CoilSupply
        The model of the supply and its coil.
    unit : int
        The number of the supply on the line.
    """

    identification = "LAMBDA,GEN30-50"
    serial_number = "0000000-0001"

    def __init__(self, supply: CoilSupply, unit: int = 6) -> None:
        self.supply = supply
        self.unit = unit
        self.ovp_V = self.highest_ovp_V = 1.1 * supply.max_voltage_V
        self.uvl_V = 0.0
        self._addressed = False
        self._mode = "LOC"
        self._last = ""
        self._unfinished = b""

    def receive(self, data: bytes) -> bytes:
        """Receive bytes, obey the messages in complete lines, and return the answers."""
        *lines, self._unfinished = (self._unfinished + data).split(b"\r")
        answers = (self._answer(line.decode("latin-1").strip()) for line in lines)
        return b"".join(answer.encode("ascii") + b"\r" for answer in answers if answer != "")

    def _answer(self, line: str) -> str:
        line = self._last = self._last if line == "\\" else line
        header, _, argument = line.partition(" ")
        if header == "ADR":
            self._addressed = argument == str(self.unit)
            return "OK" if self._addressed else ""
        if not self._addressed:
            return ""
        return self._reply(header) if header.endswith("?") else self._obey(header, argument)

    def _reply(self, question: str) -> str:
        supply = self.supply
        state = supply.state
        match question:
            case "IDN?":
                return self.identification
            case "SN?":
                return self.serial_number
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
            case "OVP?":
                return f"{self.ovp_V:06.3f}"
            case "UVL?":
                return f"{self.uvl_V:06.3f}"
            case "RMT?":
                return self._mode
            case "DVC?":
                return ", ".join(self._reply(part) for part in ("MV?", "PV?", "MC?", "PC?", "OVP?", "UVL?"))
            case "FLD?":
                return "ON" if state.armed else "OFF"
            case _ if question in _FIXED:
                return _FIXED[question]
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
            mode = {"0": "LOC", "1": "REM", "2": "LLO"}.get(argument, argument)
            if mode not in {"LOC", "REM", "LLO"}:
                return ILLEGAL_PARAMETER
            self._mode = mode
            return "OK"
        if self._mode == "LOC":
            return ILLEGAL_COMMAND
        supply = self.supply
        match header, argument:
            case "OUT", "ON" | "OFF" | "1" | "0":
                accepted = supply.switch(argument in {"ON", "1"})
            case "FLD", "ON" | "OFF" | "1" | "0":
                accepted = supply.arm(argument in {"ON", "1"})
            case "OVM", "":
                return self._set("OVP", self.highest_ovp_V)
            case "PV" | "PC" | "OVP" | "UVL", _:
                try:
                    return self._set(header, float(argument))
                except ValueError:
                    return ILLEGAL_PARAMETER
            case _:
                return ILLEGAL_COMMAND
        return "OK" if accepted or supply.locked else OUT_OF_RANGE

    def _set(self, header: str, value: float) -> str:
        """Store a set-point, and return ``OK`` or the number of an error (Genesys user manual, programming errors).

        `header` is PV (voltage, V), PC (current, A), OVP (trip level, V) or UVL (smallest voltage set-point, V).
        """
        supply, set_V = self.supply, self.supply.state.set_voltage_V
        if header == "PV" and value > min(1.05 * supply.max_voltage_V, 0.95 * self.ovp_V):
            return ABOVE_RANGE
        if header == "PV" and value < self.uvl_V:
            return BELOW_UVL
        if header == "OVP" and value < set_V + 0.05 * supply.max_voltage_V:
            return OVP_TOO_LOW
        if header == "UVL" and value > set_V:
            return UVL_TOO_HIGH
        if header == "OVP" and value > self.highest_ovp_V:
            return OUT_OF_RANGE
        if supply.locked:
            return "OK"
        match header:
            case "PV":
                accepted = supply.set_voltage(value)
            case "PC":
                accepted = supply.set_current(value)
            case "OVP":
                self.ovp_V = value
                accepted = supply.set_trip_levels(voltage_V=value)
            case _:
                self.uvl_V, accepted = value, value >= 0
        return "OK" if accepted else OUT_OF_RANGE
