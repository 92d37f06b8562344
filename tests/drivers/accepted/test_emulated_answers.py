"""Emulated supplies answer every message, and change their settings, as in stored reference files.

A line of a reference file is a message, its answer, and the settings that the message has changed, with tabs between
them. In place of a message, ``(new 2)`` makes a new supply with the coil on channel 2, ``(wait 5)`` waits for
5 s, ``(trip)`` makes a protection act, and ``(lock)`` and ``(unlock)`` begin and end the use of the front panel.
``(all)`` sends the queries in the first line of the file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators import emulate
from eimi_drivers.emulators.aim_tti import MODELS, AimTtiDialect
from eimi_drivers.emulators.serve import DIALECTS
from eimi_drivers.emulators.supply import CoilSupply

ACCEPTED = Path(__file__).parent / "emulated"
NAMES = [*(name for name in DIALECTS if name != "aim-tti"), *(f"aim-tti {model}" for model in MODELS)]
ENDS = {"korad": b"", "genesys": b"\r"}


class Described:
    # An emulated supply whose messages, answers and settings are described line by line.

    def __init__(self, name: str, queries: str) -> None:
        self.driver, _, self.model = name.partition(" ")
        self.queries = queries
        self.make(1)

    def make(self, channel: int) -> str:
        self.clock = SimulatedClock()
        self.coil = CoilSupply(
            self.clock, resistance_ohm=3.0, max_current_A=4.0, max_voltage_V=20.0, thermal_resistance_K_per_W=2.0
        )
        self.coil.set_voltage(12.0)
        self.coil.set_current(0.7)
        self.coil.switch(True)
        self.clock.sleep(1.0)
        self.instrument: Any = (
            AimTtiDialect(self.coil, channel, MODELS[self.model])
            if self.model
            else emulate(self.driver, self.coil, f"#{channel}")
        )
        self.before: dict[str, str] = {}
        return ""

    def line(self, message: str) -> str:
        match message.strip("()").split():
            case "new", channel:
                answer = self.make(int(channel))
            case "wait", seconds:
                answer = self.clock.sleep(float(seconds))
            case ["trip"]:
                answer = self.coil.trip()
            case ["lock" | "unlock" as word]:
                self.coil.locked, answer = word == "lock", ""
            case _:
                sent = self.queries if message == "(all)" else message
                end = ENDS.get(self.driver, b"\n")
                answer = self.instrument.receive(sent.encode("latin-1") + end).decode("latin-1")
        state = self.coil.state
        settings = {
            "V": f"{state.set_voltage_V:g}",
            "A": f"{state.set_current_A:g}",
            "on": str(int(state.output)),
            "armed": str(int(state.armed)),
            "tripped": str(int(state.tripped)),
            "trips at V": f"{state.trip_voltage_V:.6g}",
            "trips at A": f"{state.trip_current_A:.6g}",
        }
        changed = [f"{key} {value}" for key, value in settings.items() if self.before.get(key) != value]
        self.before = settings
        return "\t".join([message, repr(answer or "")[1:-1], ", ".join(changed)]).rstrip("\t")


@pytest.mark.parametrize("name", NAMES)
def test_every_message_has_the_accepted_answer(name: str) -> None:
    queries, *accepted = (ACCEPTED / f"{name}.txt").read_text(encoding="utf-8").splitlines()
    supply = Described(name, queries)
    for number, line in enumerate(accepted, 2):
        assert supply.line(line.partition("\t")[0]) == line, f"line {number}"
