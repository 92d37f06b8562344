"""Emulate Delta Elektronika's SM15K, and an SM supply with a PSC-ETH card.

The messages were written independently of the drivers, so that tests find a wrong message in a driver.
"""

from __future__ import annotations

import re

from eimi_drivers.emulators.output_watchdog import OutputWatchdog
from eimi_drivers.emulators.scpi import UNDEFINED_HEADER, Refused, ScpiDialect, number, switch
from eimi_drivers.emulators.supply import CoilSupply

_WORDS = (
    *("SOURCE", "VOLTAGE", "CURRENT", "MEASURE", "OUTPUT", "SYSTEM", "ERROR", "REMOTE", "LIMITS", "COMMUNICATE"),
    *("WATCHDOG", "MAXIMUM", "STATUS", "CV", "CC"),
)
SOURCES = {"REMOTE": "Ethernet", "ETHERNET": "Ethernet", "FRONT": "Front", "LOCAL": "Front", "WEB": "Web"}
"""The names of the sources of set-points in answers, by the names of the same sources in commands."""


class DeltaPscEthDialect(ScpiDialect):
    """Emulated Delta Elektronika SM supply with the network card PSC-ETH.

    The supply applies a set-point to the output after a message has selected Ethernet as the source of the set-points.
    Every message restarts the watchdog, a timer that switches the output off.
    """

    identification = "DELTA ELEKTRONIKA BV,SM70-22,EMULATED,P0102"
    no_error = "0,None"
    remote = "REM"

    def __init__(self, supply: CoilSupply, channel: int = 1) -> None:
        super().__init__(supply, channel)
        self.watchdog = OutputWatchdog(supply, 1.0)
        self._sources = {"CV": "Front", "CC": "Front"}
        self._set_points = {"CV": 0.0, "CC": 0.0}
        self._effects = {"CV": supply.set_voltage, "CC": supply.set_current}
        self._limits = {"CV": (supply.max_voltage_V, True), "CC": (supply.max_current_A, True)}
        self.questions = {
            "*IDN?": lambda: self.identification,
            "SYSTEM:ERROR?": lambda: self._errors.pop(0) if self._errors else self.no_error,
            "SOURCE:VOLTAGE?": lambda: f"{self._set_points['CV']:.4f}",
            "SOURCE:CURRENT?": lambda: f"{self._set_points['CC']:.4f}",
            "SOURCE:VOLTAGE:MAXIMUM?": lambda: f"{supply.max_voltage_V:.0f}",
            "SOURCE:CURRENT:MAXIMUM?": lambda: f"{supply.max_current_A:.0f}",
            "MEASURE:VOLTAGE?": lambda: f"{supply.read().voltage_V:.4f}",
            "MEASURE:CURRENT?": lambda: f"{supply.read().current_A:.4f}",
            "OUTPUT?": lambda: str(int(supply.output_on())),
            "SYSTEM:REMOTE:CV?": lambda: self._answer_source("CV"),
            "SYSTEM:REMOTE:CC?": lambda: self._answer_source("CC"),
            "SYSTEM:COMMUNICATE:WATCHDOG?": self._watchdog_state,
            "SYSTEM:COMMUNICATE:WATCHDOG SET?": lambda: f"{1000 * self.watchdog.seconds:.0f}",
        }
        self.commands = {
            "*CLS": self._clear_errors,
            "SOURCE:VOLTAGE": lambda argument: self._take("CV", number(argument)),
            "SOURCE:CURRENT": lambda argument: self._take("CC", number(argument)),
            "OUTPUT": lambda argument: supply.switch(switch(argument)),
            "SYSTEM:REMOTE:CV": lambda argument: self._set_source("CV", argument),
            "SYSTEM:REMOTE:CC": lambda argument: self._set_source("CC", argument),
            "SYSTEM:COMMUNICATE:WATCHDOG": self._command_watchdog,
        }

    def receive(self, data: bytes) -> bytes:
        """Receive bytes, restart the watchdog (a timer that switches the output off), and return the answers."""
        self.watch()
        self.watchdog.restart()
        return super().receive(data)

    def watch(self) -> None:
        """Switch the output off if the watchdog (a timer that every message restarts) has expired."""
        self.watchdog.watch()

    def _shortened(self, line: str) -> str:
        header, space, argument = line.removeprefix(":").partition(" ")
        mark = "?" if header.endswith("?") else ""
        words = [self._whole(word) for word in re.sub(r"\[|\]", "", header.removesuffix("?")).split(":")]
        if len(words) > 2 and words[-1] == "STATUS":  # SYSTem:REMote:CV[:STAtus]
            words.pop()
        return ":".join(words) + mark + space + argument

    @staticmethod
    def _whole(word: str) -> str:
        if word.startswith("*"):
            return word
        for whole in _WORDS:
            if whole.startswith(word) and len(word) >= min(3, len(whole)):
                return whole
        raise Refused(UNDEFINED_HEADER)

    def _answer_source(self, quantity: str) -> str:
        source = self._sources[quantity]
        return self.remote if source == "Ethernet" else source

    def _set_source(self, quantity: str, argument: str) -> bool:
        matches = [answer for name, answer in SOURCES.items() if name.startswith(argument) and len(argument) >= 3]
        if not matches or self.supply.locked:
            return False
        self._sources[quantity] = matches[0]
        return self._take(quantity, self._set_points[quantity])

    def _take(self, quantity: str, value: float) -> bool:
        """Store a set-point, and return whether the supply accepted the value.

        `quantity` is "CV" for the voltage (V) or "CC" for the current (A).
        """
        limit, on = self._limits[quantity]
        highest = {"CV": self.supply.max_voltage_V, "CC": self.supply.max_current_A}[quantity]
        if self.supply.locked or not 0 <= value <= (min(limit, highest) if on else highest):
            return False
        self._set_points[quantity] = value
        return self._sources[quantity] != "Ethernet" or self._effects[quantity](value)

    def _watchdog_state(self) -> str:
        if self.watchdog.expired:
            self.watchdog.switch(False)
            return "0"
        return f"{1000 * self.watchdog.seconds:.0f}" if self.watchdog.on else "-1"

    def _command_watchdog(self, argument: str) -> bool:
        if argument == "STOP":
            return self.watchdog.switch(False)
        if not argument.startswith("SET,"):
            return False
        milliseconds = number(argument.removeprefix("SET,"))
        return self.watchdog.set_seconds(milliseconds / 1000, 0.02, 10.0) and self.watchdog.switch(True)


class DeltaSm15kDialect(DeltaPscEthDialect):
    """Emulated Delta Elektronika SM15K, whose set-points can be limited."""

    identification = "DELTA ELEKTRONIKA B.V.,SM70-CP-450,EMULATED,P0110"
    remote = "Ethernet"

    def __init__(self, supply: CoilSupply, channel: int = 1) -> None:
        super().__init__(supply, channel)
        for quantity, word in (("CV", "VOLTAGE"), ("CC", "CURRENT")):
            self.questions[f"SYSTEM:LIMITS:{word}?"] = lambda quantity=quantity: self._limit(quantity)  # type: ignore[misc]
            self.commands[f"SYSTEM:LIMITS:{word}"] = lambda argument, quantity=quantity: self._set_limit(
                quantity, argument
            )  # type: ignore[misc]

    def _limit(self, quantity: str) -> str:
        limit, on = self._limits[quantity]
        return f"{limit:.4f},{'ON' if on else 'OFF'}"

    def _set_limit(self, quantity: str, argument: str) -> bool:
        limit, _, on = argument.partition(",")
        if self.supply.locked:
            return False
        self._limits[quantity] = (number(limit), switch(on))
        return True
