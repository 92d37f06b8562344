"""Emulate the commands that all families of SCPI supplies share."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

from eimi_drivers.emulators.supply import CoilSupply

MISSING_PARAMETER = '-109,"Missing parameter"'
UNDEFINED_HEADER = '-113,"Undefined header"'
DATA_TYPE_ERROR = '-104,"Data type error"'
COMMAND_PROTECTED = '-203,"Command protected"'
OUT_OF_RANGE = '-222,"Data out of range"'
HARDWARE_MISSING = '-241,"Hardware missing"'

_SHORT = {
    long.upper(): long.rstrip("abcdefghijklmnopqrstuvwxyz")
    for long in (
        *("SOURce", "VOLTage", "CURRent", "OUTPut", "MEASure", "SYSTem", "ERRor", "PROTection", "STATe", "TRIPped"),
        *("CLEar", "INSTrument", "NSELect", "SELect", "LEVel", "IMMediate", "AMPLitude", "FUNCtion", "LIMit"),
        *("POSitive", "NEGative", "GENeral", "VALue", "SCALar", "STATus", "VERSion", "QUEStion", "APPLy", "TRACk"),
        *("BEEPer", "LOCal", "REMote", "RWLock", "TIMer", "DELay", "CONDition"),
    )
}
_OPTIONAL = frozenset({"SOUR", "LEV", "IMM", "AMPL", "SCAL", "DC", "NEXT", "STAT"})
"""Words that can be omitted from a message (SCPI-99, volume 1, 6.2.1)."""

_SWITCH = {"1": True, "ON": True, "0": False, "OFF": False}
_WITHOUT_EFFECT = ("SYST:LOC", "SYST:REM", "SYST:RWL", "SYST:BEEP", "SYST:BEEP:STAT")
"""Commands for the front panel and the beeper, which are accepted but have no effect."""


class Refused(Exception):
    """The error that is raised if the supply refuses a message."""


class ScpiDialect:
    """Emulated one-channel SCPI supply with an error queue (SCPI-99, volume 2, 21).

    Parameters
    ----------
    supply : CoilSupply
        The model of the supply and its coil.
    channel : int
        The channel (the output of the supply) that feeds the coil.

    Attributes
    ----------
    questions : dict
        The function that returns the answer to a query, by the header of the query (short form, capitals).
    commands : dict
        The function that obeys a command, by the header of the command (short form, capitals). The function takes the
        argument of the command and returns whether the supply accepted the command.
    serial_line_begins_local : bool
        True if every message on a serial line is lost until the message ``SYST:REM`` or ``SYST:RWL`` arrives.
    reset_current_A : float
        The current set-point (A) after ``*RST``.
    """

    serial_line_begins_local: ClassVar[bool] = False
    identification = "EIMI,EMULATED SUPPLY,0,1.0"
    no_error = '0,"No error"'
    reset_current_A = 0.0

    def __init__(self, supply: CoilSupply, channel: int = 1) -> None:
        self.supply = supply
        self.channel = channel
        self.questions: dict[str, Callable[[], str]] = {
            "*IDN?": lambda: self.identification,
            "SYST:ERR?": lambda: self._errors.pop(0) if self._errors else self.no_error,
            "VOLT?": lambda: f"{supply.state.set_voltage_V:.6E}",
            "CURR?": lambda: f"{supply.state.set_current_A:.6E}",
            "MEAS:VOLT?": lambda: f"{supply.read().voltage_V:.6E}",
            "MEAS:CURR?": lambda: f"{supply.read().current_A:.6E}",
            "OUTP?": lambda: "1" if supply.output_on() else "0",
            "*OPC?": lambda: "1",
            "*ESR?": lambda: "0",
            "*STB?": lambda: "0",
            "*OPT?": lambda: "0",
            "*TST?": lambda: "0",
            "MEAS:POWE?": lambda: f"{supply.read().voltage_V * supply.read().current_A:.6E}",
            "VOLT? MIN": lambda: "0.000000E+00",
            "CURR? MIN": lambda: "0.000000E+00",
            "VOLT? MAX": lambda: f"{supply.max_voltage_V:.6E}",
            "CURR? MAX": lambda: f"{supply.max_current_A:.6E}",
            "SYST:VERS?": lambda: "1999.0",
        }
        self.commands: dict[str, Callable[[str], bool]] = {
            "*CLS": self._clear_errors,
            "*RST": lambda argument: supply.reset(self.reset_current_A),
            "VOLT": lambda argument: supply.set_voltage(number(argument)),
            "CURR": lambda argument: supply.set_current(number(argument)),
            "OUTP": lambda argument: supply.switch(switch(argument)),
            **{header: lambda argument: True for header in _WITHOUT_EFFECT},
        }
        self._errors: list[str] = []
        self._unfinished = b""
        self._is_local = False

    def connect_serially(self) -> None:
        """Begin a connection over a serial line."""
        self._is_local = self.serial_line_begins_local

    def receive(self, data: bytes) -> bytes:
        """Receive bytes, obey the messages in complete lines, and return the answers."""
        *lines, self._unfinished = (self._unfinished + data).split(b"\n")
        replies = (self._reply_to_line(line.decode("latin-1").strip().upper()) for line in lines)
        return b"".join(reply.encode("ascii") + b"\n" for reply in replies if reply)

    def _reply_to_line(self, line: str) -> str:
        answers = [self._answer(message.strip()) for message in line.split(";")]
        return ";".join(answer for answer in answers if answer is not None)

    def _parse(self, line: str) -> tuple[str, str]:
        """Return the header of a SCPI message in its short form, and the argument of the message."""
        header, _, argument = line.partition(" ")
        return header, argument.strip()

    def _shortened(self, line: str) -> str:
        """Return a SCPI message with the short form of its header."""
        header, space, argument = line.removeprefix(":").partition(" ")
        mark = "?" if header.endswith("?") else ""
        words = [_SHORT.get(word, word) for word in header.removesuffix("?").split(":")]
        without_source = [word for word in words if word != "SOUR"]
        for candidate in (words, without_source, [word for word in words if word not in _OPTIONAL]):
            if (short := ":".join(candidate) + mark) in self.questions or short in self.commands:
                return short + space + argument
        return ":".join(words) + mark + space + argument

    def _answer(self, line: str) -> str | None:
        if not line:
            return None
        try:
            short = self._shortened(line)
            if self._is_local and short.strip() not in {"SYST:REM", "SYST:RWL"}:
                return None
            self._is_local = False
            header, argument = self._parse(short)
            question = f"{header} {argument}".strip()
            if question in self.questions:
                return self.questions[question]()
            if header not in self.commands:
                raise Refused(UNDEFINED_HEADER)
            if not self.commands[header](argument):
                raise Refused(COMMAND_PROTECTED if self.supply.locked else OUT_OF_RANGE)
        except Refused as refusal:
            self._errors.append(str(refusal))
        return None

    def _clear_errors(self, argument: str) -> bool:
        self._errors.clear()
        return True


def number(argument: str) -> float:
    """Return the number in the argument of a command. Raises Refused if the argument is not a number."""
    try:
        return float(argument)
    except ValueError:
        raise Refused(DATA_TYPE_ERROR) from None


def switch(argument: str) -> bool:
    """Return True for the argument ON or 1, and False for OFF or 0. Raises Refused for any other argument."""
    if argument not in _SWITCH:
        raise Refused(DATA_TYPE_ERROR)
    return _SWITCH[argument]
