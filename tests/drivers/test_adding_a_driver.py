"""The driver that the README shows is a working one."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators import CoilSupply
from eimi_drivers.interfaces import Limits, PowerSupply, ReplyNotUnderstood
from eimi_drivers.supplies import SUPPLIES
from eimi_drivers.supplies.transport import InProcessTransport

README = Path(__file__).parents[2] / "drivers" / "README.md"


class GenesysDialect:
    def __init__(self, supply: CoilSupply) -> None:
        self.supply = supply

    def receive(self, data: bytes) -> bytes:
        name, _, value = data.decode("ascii").strip("\r").partition(" ")
        supply = self.supply
        questions = {
            "IDN?": lambda: "LAMBDA,GEN20-38",
            "OUT?": lambda: "ON" if supply.output_on() else "OFF",
            "PV?": lambda: f"{supply.state.set_voltage_V:.3f}",
            "PC?": lambda: f"{supply.state.set_current_A:.3f}",
            "MV?": lambda: f"{supply.read().voltage_V:.3f}",
            "MC?": lambda: f"{supply.read().current_A:.3f}",
        }
        if name in questions:
            return questions[name]().encode("ascii") + b"\r"
        if name == "OUT":
            supply.switch(value == "ON")
            return b"OK\r"
        taken = supply.set_voltage(float(value)) if name == "PV" else supply.set_current(float(value))
        return b"OK\r" if taken else b"E01\r"


def test_the_driver_in_the_readme_works(monkeypatch):
    monkeypatch.setattr("eimi_drivers.supplies.SUPPLIES", dict(SUPPLIES))
    blocks = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    names: dict[str, object] = {"__name__": "readme"}
    exec(next(block for block in blocks if "GenesysSupply" in block), names)
    clock = SimulatedClock()
    coil = CoilSupply(clock, max_current_A=2.0)
    link = InProcessTransport(GenesysDialect(coil), clock)
    supply = names["SUPPLIES"]["genesys"](link, Limits(current_A=3.0, voltage_V=12.0), clock)
    assert isinstance(supply, PowerSupply)
    assert supply.identify().text == "LAMBDA,GEN20-38"
    supply.set_voltage(12.0)
    supply.set_current(0.705)
    supply.set_output(True)
    clock.sleep(10.0)
    assert supply.measure().current_A == pytest.approx(0.70)
    with pytest.raises(ReplyNotUnderstood, match="E01"):
        supply.set_current(2.5)
    supply.safe_off()
    assert not coil.state.output
