"""Emulate the command language of BK Precision XLN supplies."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.emulators.trip_level import TripLevel


class XlnDialect:
    """Emulated BK Precision XLN.

    Parameters
    ----------
    supply : CoilSupply
        The model of the supply and its coil.
    """

    model, version = "XLN3640", "1.08"
    identification = f"{model} {version}"

    def __init__(self, supply: CoilSupply) -> None:
        self.supply = supply
        self._ovp = TripLevel(supply, "voltage_V", 1.1 * supply.max_voltage_V, on=False)
        self._ocp = TripLevel(supply, "current_A", 1.1 * supply.max_current_A, on=False)
        self._unfinished = b""
        state = lambda: supply.state  # noqa: E731
        self._questions: dict[str, Callable[[], str]] = {
            "MODEL?": lambda: self.model,
            "VERSION?": lambda: self.version,
            **dict.fromkeys(("VOLT?", "VOLTAGE?", "VSET?"), lambda: f"{state().set_voltage_V:.3f}"),
            **dict.fromkeys(("CURR?", "CURRENT?", "ISET?"), lambda: f"{state().set_current_A:.3f}"),
            "VOUT?": lambda: f"{supply.read().voltage_V:.3f}",
            "IOUT?": lambda: f"{supply.read().current_A:.3f}",
            "OVSET?": lambda: f"{self._ovp.level:.2f}",
            "OISET?": lambda: f"{self._ocp.level:.3f}",
            "STATUS?": self._status,
        }
        self._commands: dict[str, Callable[[float], bool]] = {
            **dict.fromkeys(("VOLT", "VOLTAGE", "VSET"), supply.set_voltage),
            **dict.fromkeys(("CURR", "CURRENT", "ISET"), supply.set_current),
            "OUT": lambda value: supply.switch(value == 1),
            "OVSET": self._ovp.set_level,
            "OISET": self._ocp.set_level,
            "OVP": lambda value: self._ovp.switch(value == 1),
            "OCP": lambda value: self._ocp.switch(value == 1),
        }

    def receive(self, data: bytes) -> bytes:
        """Receive bytes, obey the messages in complete lines, and return the answers."""
        *lines, self._unfinished = (self._unfinished + data).split(b"\n")
        answers = (self._answer(line.decode("latin-1").strip().upper()) for line in lines)
        return b"".join(answer.encode("ascii") + b"\r\n" for answer in answers if answer != "")

    def _answer(self, line: str) -> str:
        if line in self._questions:
            return self._questions[line]()
        header, _, argument = line.partition(" ")
        if header == "CLR":
            self.supply.clear_trip()
        elif header in self._commands:
            with suppress(ValueError):
                self._commands[header](float(argument))
        return ""

    def _status(self) -> str:
        output = 0x04 if self.supply.output_on() else 0  # evaluated first: a protection may act in this call
        state = self.supply.state
        armed = (0x80 if self._ovp.on else 0) | (0x40 if self._ocp.on else 0)
        flag = 0x8000 if abs(state.set_voltage_V) > state.trip_voltage_V else 0x4000
        return f"{(flag if state.tripped else 0) | armed | output:06X}"
