"""Emulate gaussmeters and other sensors."""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import Enum
from typing import ClassVar

import numpy as np

from eimi_drivers.installed import did_you_mean
from eimi_drivers.interfaces import Clock, InstrumentError
from eimi_drivers.supplies.transport import Responder


class SensorFault(Enum):
    """A fault of an emulated sensor, with its effect and with the behaviour of a correct program."""

    STUCK = ("the value does not change any more", "stores the values; an interlock cannot notice this fault")
    JUMP = ("the value is a hundred times too large", "ends the run if an interlock bounds the sensor")

    def __init__(self, effect: str, correct: str) -> None:
        self.effect = effect
        self.correct = correct

    @property
    def word(self) -> str:
        """Return the name of the fault in the options of commands, such as "stuck"."""
        return self.name.lower()


class EmulatedQuantity:
    """A quantity that an emulated sensor measures: a true value with normally distributed noise.

    Parameters
    ----------
    clock : Clock
        The clock of the sensor.
    true : callable
        Returns the present true value in `unit`.
    unit : str
        "mT" or "degC".
    noise : float
        The standard deviation of the noise, in `unit`.
    seed : int
        The seed of the noise.

    Attributes
    ----------
    fault : SensorFault or None
        The present fault of the sensor.
    """

    def __init__(
        self, clock: Clock, true: Callable[[], float], unit: str = "mT", noise: float = 0.0, seed: int = 0
    ) -> None:
        self.clock, self.unit, self.noise = clock, unit, noise
        self.fault: SensorFault | None = None
        self._true = true
        self._random = np.random.default_rng(seed)
        self._last = 0.0

    def read(self) -> float:
        """Return a measured value, in `unit`."""
        if self.fault is not SensorFault.STUCK:
            self._last = self._true() + float(self._random.normal(0.0, self.noise))
        return 100.0 * self._last if self.fault is SensorFault.JUMP else self._last


class SensorDialect:
    """Base class of emulated sensors, which answer each query with one line.

    Parameters
    ----------
    quantity : EmulatedQuantity
        The measured quantity.

    Attributes
    ----------
    identification : str
        The answer to ``*IDN?``.
    """

    identification = ""
    ends_with = b"\r\n"

    def __init__(self, quantity: EmulatedQuantity) -> None:
        self.quantity = quantity
        self._pending = b""

    def receive(self, data: bytes) -> bytes:
        """Receive bytes, and return the answers to the complete queries."""
        *queries, self._pending = (self._pending + data).split(b"\n")
        answers = (self._answer(query.decode("ascii", "replace").strip()) for query in queries)
        return b"".join(answer.encode("ascii") + self.ends_with for answer in answers if answer != "")

    def _answer(self, query: str) -> str:
        return self.identification if query == "*IDN?" else self.answer(query)

    def answer(self, query: str) -> str:
        """Return the answer to a query other than ``*IDN?``; an empty text if the query has no answer."""
        raise InstrumentError(f"the emulated sensor {type(self).__name__} has no method that answers {query}")


class LakeShoreDialect(SensorDialect):
    """Emulated Lake Shore 425, which answers in the formats of its manual, section 6.3.1."""

    identification = "LSCI,MODEL425,4250022,1.0"
    unit = 2
    per_mT: ClassVar[dict[int, float]] = {1: 10.0, 2: 1e-3, 3: 10.0, 4: 1e4 / (4 * math.pi)}
    """A field of 1 mT in air, in gauss (1), tesla (2), oersted (3) and A/m (4)."""

    def __init__(self, quantity: EmulatedQuantity) -> None:
        super().__init__(quantity)
        self._range, self._mode = "1", "1,0,1"

    def answer(self, query: str) -> str:
        """Return the answer to a query, or obey a command and return an empty text."""
        header, _, argument = query.partition(" ")
        match header:
            case "UNIT?":
                return f"{self.unit}"
            case "RDGFIELD?":
                return f"{self.quantity.read() * self.per_mT[self.unit]:+.5E}"
            case "RANGE?":
                return self._range
            case "RDGMODE?":
                return self._mode
            case "UNIT" if argument in {"1", "2", "3", "4"}:
                self.unit = int(argument)
            case "RANGE":
                self._range = argument
            case "RDGMODE":
                self._mode = argument
        return ""


class LakeShore475Dialect(LakeShoreDialect):
    """Emulated Lake Shore 475, whose unit is gauss at the start."""

    identification = "LSCI,MODEL475,4750011,1.1"
    unit = 1


class FWBellDialect(SensorDialect):
    """Emulated F.W. Bell 5080, whose unit is gauss at the start."""

    identification = "FW BELL,5080,0,1.0"
    units: ClassVar[dict[str, tuple[float, str]]] = {"GAUSS": (10.0, "G"), "TESLA": (1e-3, "T")}

    def __init__(self, quantity: EmulatedQuantity) -> None:
        super().__init__(quantity)
        self._unit, self._range = "GAUSS", "1"

    def answer(self, query: str) -> str:
        """Return the answer to a query, or obey a command and return an empty text."""
        words = query.upper().replace("MEASURE", "MEAS")
        header, _, argument = words.partition(" ")
        match header:
            case ":MEAS:FLUX?":
                per_mT, letter = self.units[self._unit]
                return f"{per_mT * self.quantity.read():.6g}{letter};"
            case ":UNIT:FLUX?":
                return f"DC {self._unit};"
            case ":SENS:FLUX:RANG?":
                return f"{self._range};"
            case ":SENS:FLUX:RANG":
                self._range = argument
            case _ if header.startswith(":UNIT:FLUX:DC:") and header.rpartition(":")[2] in self.units:
                self._unit = header.rpartition(":")[2]
        return ""


class TextLineDialect(SensorDialect):
    """Emulated microcontroller board that answers like a board with the program in docs/howto/measure_the_field.md."""

    identification = "eimi-lab,hall-board,1,1.0"

    def answer(self, query: str) -> str:
        """Return value, unit and standard uncertainty for the query ``READ?``, and an empty text for other queries."""
        quantity = self.quantity
        return f"{quantity.read():.5f} {quantity.unit} {quantity.noise:.5f}" if query == "READ?" else ""


SENSOR_DIALECTS: dict[str, Callable[[EmulatedQuantity], SensorDialect]] = {
    "lakeshore-425": LakeShoreDialect,
    "lakeshore-475": LakeShore475Dialect,
    "fwbell-5080": FWBellDialect,
    "text-line": TextLineDialect,
}
"""The emulated sensors by the names of the drivers that read them."""


def emulate_sensor(driver: str, quantity: EmulatedQuantity) -> Responder:
    """Return an emulated sensor for the driver with this name. Raises InstrumentError if there is no such sensor."""
    if driver not in SENSOR_DIALECTS:
        raise InstrumentError(
            f"there is no emulated sensor {driver!r}; the names are: {', '.join(SENSOR_DIALECTS)}"
            f"{did_you_mean(driver, SENSOR_DIALECTS)}"
        )
    return SENSOR_DIALECTS[driver](quantity)
