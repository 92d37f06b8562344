"""SCPI on the emulated supply: what the families have in common. `scpi_families` has what sets them apart."""

from __future__ import annotations

from collections.abc import Callable

from eimi_drivers.emulators.supply import CoilSupply

UNDEFINED_HEADER = '-113,"Undefined header"'
DATA_TYPE_ERROR = '-104,"Data type error"'
COMMAND_PROTECTED = '-203,"Command protected"'
OUT_OF_RANGE = '-222,"Data out of range"'
HARDWARE_MISSING = '-241,"Hardware missing"'

_SHORT = {
    long.upper(): long.rstrip("abcdefghijklmnopqrstuvwxyz")
    for long in (
        *("SOURce", "VOLTage", "CURRent", "OUTPut", "MEASure", "SYSTem", "ERRor", "PROTection", "STATe", "TRIPped"),
        *("CLEar", "INSTrument", "NSELect", "LEVel", "IMMediate", "AMPLitude", "FUNCtion", "LIMit", "POSitive"),
        *("NEGative", "GENeral", "VALue", "SCALar", "STATus", "VERSion", "QUEStion"),
    )
}
_OPTIONAL = frozenset({"SOUR", "LEV", "IMM", "AMPL", "SCAL", "DC", "NEXT", "STAT"})
"""Words that a message may leave out, where the instrument knows it without them (SCPI-99, volume 1, 6.2.1)."""

_SWITCH = {"1": True, "ON": True, "0": False, "OFF": False}


class Refused(Exception):
    """A message that the instrument answers with an entry in its error queue."""


class ScpiDialect:
    """Answers lines as a one-channel SCPI supply does, error queue included (SCPI-99, volume 2, 21).

    channel: the one that the coil is on, of a supply that has several.
    questions, commands: what each header does, in capitals and as short as the standard allows.
    """

    identification = "EIMI,EMULATED SUPPLY,0,1.0"
    no_error = '0,"No error"'

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
            "VOLT": lambda argument: supply.set_voltage(number(argument)),
            "CURR": lambda argument: supply.set_current(number(argument)),
            "OUTP": lambda argument: supply.switch(switch(argument)),
        }
        self._errors: list[str] = []
        self._unfinished = b""

    def receive(self, data: bytes) -> bytes:
        """Take bytes, return the answers to the lines that they complete."""
        *lines, self._unfinished = (self._unfinished + data).split(b"\n")
        answers = (self._answer(line.decode("latin-1").strip().upper()) for line in lines)
        return b"".join(answer.encode("ascii") + b"\n" for answer in answers if answer is not None)

    def _parse(self, line: str) -> tuple[str, str]:
        """The header and the argument of a line, as the tables above know them."""
        header, _, argument = line.partition(" ")
        return header, argument.strip()

    def _shortened(self, line: str) -> str:
        """A line with its header as the tables know it: long words cut short, and those left out that may be."""
        header, space, argument = line.removeprefix(":").partition(" ")
        mark = "?" if header.endswith("?") else ""
        words = [_SHORT.get(word, word) for word in header.removesuffix("?").split(":")]
        for known in (words, [word for word in words if word not in _OPTIONAL]):
            if (short := ":".join(known) + mark) in self.questions or short in self.commands:
                return short + space + argument
        return ":".join(words) + mark + space + argument

    def _answer(self, line: str) -> str | None:
        if not line:
            return None
        try:
            header, argument = self._parse(self._shortened(line))
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
    """A number. Raises Refused."""
    try:
        return float(argument)
    except ValueError:
        raise Refused(DATA_TYPE_ERROR) from None


def switch(argument: str) -> bool:
    """ON or OFF, 1 or 0. Raises Refused."""
    if argument not in _SWITCH:
        raise Refused(DATA_TYPE_ERROR)
    return _SWITCH[argument]
