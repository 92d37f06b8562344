"""Emulate the command language of Aim-TTi supplies of the QL (Series II), MX, QPX and CPX series."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.emulators.trip_level import TripLevel

COMMAND_ERROR, NUMBERED_ERROR, POWER_ON = 0x20, 0x10, 0x80
CONSTANT_VOLTAGE, CONSTANT_CURRENT = 0x01, 0x02
LOCKED_OUT = 200


@dataclass(frozen=True)
class Model:
    """One model of an Aim-TTi supply.

    Parameters
    ----------
    name : str
        The name of the model in the answer to ``*IDN?``.
    over_voltage, over_current : int
        The bits of the answer to ``LSR1?`` that report a trip of the over-voltage and the over-current protection.
    out_of_range : int
        The number of the error for a value outside the range.
    range_refused : int
        The number of the error for a change of the range while the output is on.
    ranges : mapping of int to (float, float)
        The largest voltage (V) and the largest current (A), by the number of the range.
    range : str
        The command for the range; empty if the model has only one range.
    range_answer : str
        The form of the answer to the query for the range.
    """

    name: str
    over_voltage: int = 0x04
    over_current: int = 0x08
    out_of_range: int = 100
    range_refused: int = 104
    ranges: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    range: str = ""
    range_answer: str = "{}"


CPX400DP = Model("CPX400DP")
QPX1200SP = Model("QPX1200SP", over_voltage=0x08, over_current=0x10)
MX100TP = Model("MX100TP", ranges={1: (16.0, 6.0), 2: (35.0, 3.0)}, range="VRANGE")
QL355TP = Model(
    "QL355TP",
    out_of_range=120,
    range_refused=124,
    ranges={0: (15.0, 5.0), 1: (35.0, 3.0), 2: (35.0, 0.5)},
    range="RANGE",
    range_answer="R{channel} {range}",
)
MODELS = {model.name: model for model in (CPX400DP, QPX1200SP, MX100TP, QL355TP)}


class AimTtiDialect:
    """Emulated Aim-TTi supply, of which one output feeds the coil.

    Parameters
    ----------
    supply : CoilSupply
        The model of the supply and its coil.
    channel : int
        The number of the output that feeds the coil.
    model : Model
        The type of Aim-TTi supply that is emulated.

    Attributes
    ----------
    lock : int
        The holder of the exclusive control: 1 for this interface, 0 for no interface, -1 for another interface.
    """

    identification = "THURLBY THANDAR, CPX400DP, EMULATED, 1.00 - 1.00"

    def __init__(self, supply: CoilSupply, channel: int = 1, model: Model = CPX400DP) -> None:
        self.supply = supply
        self.channel = channel
        self.model = model
        self.lock = 0
        self._events, self._error, self._limits = POWER_ON, 0, 0
        self._range = min(model.ranges, default=0)
        self._protections = {
            "OVP": TripLevel(supply, "voltage_V", 1.1 * supply.max_voltage_V),
            "OCP": TripLevel(supply, "current_A", 1.1 * supply.max_current_A),
        }
        self._was_tripped = False
        self._unfinished = b""

    def receive(self, data: bytes) -> bytes:
        """Receive bytes, obey the messages in complete lines, and return the answers."""
        *lines, self._unfinished = (self._unfinished + data).split(b"\n")
        answers = []
        for line in lines:
            for message in line.decode("latin-1").upper().split(";"):
                if message.strip():
                    answers.append(self._answer(message.strip()))
        return b"".join(answer.encode("ascii") + b"\r\n" for answer in answers if answer != "")

    def _answer(self, message: str) -> str:
        self._note_limits()
        if message in {"IFLOCK", "IFUNLOCK", "IFLOCK?"}:
            return self._change_lock(message)
        if message.startswith("*") or message in {"EER?", "QER?", "ADDRESS?"}:
            return self._common(message)
        if message == "LOCAL":
            return ""
        if self.lock == -1 and not message.endswith("?"):
            self._refuse(LOCKED_OUT)
            return ""
        if message == "TRIPRST":
            self._refuse_unless(self.supply.clear_trip())
            return ""
        if match := re.fullmatch(r"OPALL ([01])", message):
            self._refuse_unless(self.supply.switch(match[1] == "1"))
            return ""
        match = re.fullmatch(r"([A-Z]+?)(\d)(O?)(\?|V? +\S+)", message)
        if match is None:
            self._events |= COMMAND_ERROR
            return ""
        header, channel, measured, argument = match.groups()
        if channel != str(self.channel):
            self._refuse(103)
            return ""
        if argument == "?":
            return self._reply(header + measured)
        self._set(header, argument.lstrip("V").strip())
        return ""

    def _common(self, message: str) -> str:
        match message:
            case "*IDN?":
                return self.identification.replace(CPX400DP.name, self.model.name)
            case "*CLS":
                self._events = self._error = self._limits = 0
            case "*ESR?":
                events, self._events = self._events, 0
                return str(events)
            case "EER?":
                error, self._error = self._error, 0
                return str(error)
            case "QER?" | "*STB?" | "*TST?":
                return "0"
            case "*OPC?":
                return "1"
            case "*WAI" | "*OPC":  # every command is complete before the next one is read
                return ""
            case "ADDRESS?":
                return "11"
            case "*RST":
                self._refuse_unless(self.supply.reset(1.0))
            case _:
                self._events |= COMMAND_ERROR
        return ""

    def _change_lock(self, message: str) -> str:
        if self.lock != -1 and message != "IFLOCK?":
            self.lock = int(message == "IFLOCK")
        elif message == "IFUNLOCK":
            self._refuse(LOCKED_OUT)
        return str(self.lock)

    def _reply(self, header: str) -> str:
        supply, state = self.supply, self.supply.state
        match header:
            case "V":
                return f"V{self.channel} {state.set_voltage_V:.3f}"
            case "I":
                return f"I{self.channel} {state.set_current_A:.3f}"
            case "VO":
                return f"{supply.read().voltage_V:.3f}V"
            case "IO":
                return f"{supply.read().current_A:.4f}A"
            case "OP":
                return str(int(supply.output_on()))
            case "OVP" | "OCP":
                protection = self._protections[header]
                return f"{header[1:]}{self.channel} " + (f"{protection.level:.3f}" if protection.on else "OFF")
            case "LSR":
                limits, self._limits = self._limits, 0
                return str(limits)
            case _ if header == self.model.range and header:
                return self.model.range_answer.format(self._range, channel=self.channel, range=self._range)
        self._events |= COMMAND_ERROR
        return ""

    def _set(self, header: str, argument: str) -> None:
        if header in self._protections and argument in {"ON", "OFF"}:
            self._refuse_unless(self._protections[header].switch(argument == "ON"))
            return
        try:
            number = float(argument)
        except ValueError:
            self._events |= COMMAND_ERROR
            return
        supply = self.supply
        highest_V, highest_A = self.model.ranges.get(self._range, (supply.max_voltage_V, supply.max_current_A))
        match header:
            case "V":
                self._refuse_unless(number <= highest_V and supply.set_voltage(number))
            case "I":
                self._refuse_unless(number <= highest_A and supply.set_current(number))
            case "OP":
                self._refuse_unless(number in {0, 1} and supply.switch(number == 1))
            case "OVP" | "OCP":
                self._refuse_unless(self._protections[header].set_level(number))
            case _ if header == self.model.range and header:
                if supply.output_on():
                    self._refuse(self.model.range_refused)
                elif int(number) not in self.model.ranges:
                    self._refuse(self.model.out_of_range)
                else:
                    self._range = int(number)
            case _:
                self._events |= COMMAND_ERROR

    def _refuse_unless(self, accepted: bool) -> None:
        """Store an error if `accepted` is false."""
        if not accepted:
            self._refuse(LOCKED_OUT if self.supply.locked else self.model.out_of_range)

    def _refuse(self, number: int) -> None:
        self._events |= NUMBERED_ERROR
        self._error = number

    def _note_limits(self) -> None:
        """Update the register from which a program reads limits and trips (the limit event status register)."""
        supply = self.supply
        if supply.output_on():
            self._limits |= CONSTANT_VOLTAGE if supply.constant_voltage() else CONSTANT_CURRENT
        tripped = supply.state.tripped
        if tripped and not self._was_tripped:
            too_high_V = abs(supply.state.set_voltage_V) > supply.state.trip_voltage_V
            self._limits |= self.model.over_voltage if too_high_V else self.model.over_current
        self._was_tripped = tripped
