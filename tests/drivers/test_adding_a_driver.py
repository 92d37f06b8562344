"""The driver in docs/howto/add_a_supply.md works, and the program finds it if it is in an installed package."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import pytest

from eimi_drivers import discovery
from eimi_drivers.cameras import CAMERAS, open_camera
from eimi_drivers.clock import WallClock
from eimi_drivers.emulators import CoilSupply, serve_pty
from eimi_drivers.interfaces import InstrumentError, Limits, PowerSupply, ReplyNotUnderstood, UnusableDriver
from eimi_drivers.supplies import SUPPLIES, open_supply

PAGE = Path(__file__).parents[2] / "docs" / "howto" / "add_a_supply.md"


class BenchDialect:
    # An emulated supply for the driver in docs/howto/add_a_supply.md.

    def __init__(self, supply: CoilSupply) -> None:
        self.supply = supply

    def receive(self, data: bytes) -> bytes:
        return b"".join(self._answer(line) for line in data.decode("ascii").splitlines())

    def _answer(self, line: str) -> bytes:
        name, _, value = line.partition(" ")
        supply = self.supply
        questions = {
            "*IDN?": lambda: "OUR LAB, BENCH SUPPLY, 0, 1.0",
            "OP1?": lambda: str(int(supply.output_on())),
            "V1?": lambda: f"V1 {supply.state.set_voltage_V:.2f}",
            "I1?": lambda: f"I1 {supply.state.set_current_A:.3f}",
            "V1O?": lambda: f"{supply.read().voltage_V:.2f}V",
            "I1O?": lambda: f"{supply.read().current_A:.3f}A",
        }
        if name in questions:
            return questions[name]().encode("ascii") + b"\r\n"
        commands = {
            "OP1": lambda: supply.switch(value == "1"),
            "V1": lambda: supply.set_voltage(float(value)),
            "I1": lambda: supply.set_current(float(value)),
        }
        commands[name]()
        return b""


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


def install(folder: Path, group: str, points: dict[str, str]) -> None:
    # Write the metadata of an installed package into a folder.
    # points : entry points (driver to class) in this group
    information = folder / "some_lab-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: some-lab\nVersion: 1.0\n")
    lines = [f"[{group}]", *(f"{name} = {value}" for name, value in points.items())]
    (information / "entry_points.txt").write_text("\n".join(lines) + "\n")


@pytest.fixture
def shown_driver(monkeypatch, tmp_path):
    # Install the driver of the documentation as a package; return its name.
    code = next(block for block in blocks("python") if "class BenchSupply" in block)
    table = next(block for block in blocks("toml") if "entry-points" in block)
    assert len([line for line in (code + table).splitlines() if line.strip()]) <= 40
    (tmp_path / "bench_supply.py").write_text(code, encoding="utf-8")
    for group, points in tomllib.loads(table)["project"]["entry-points"].items():
        install(tmp_path, group, points)
    monkeypatch.syspath_prepend(str(tmp_path))
    yield "bench-supply"
    sys.modules.pop("bench_supply", None)


def test_the_driver_in_the_documentation_conforms(shown_driver):
    coil = CoilSupply(WallClock(), max_current_A=2.0, time_constant_s=1e-5)
    with serve_pty(BenchDialect(coil)) as port:
        supply = open_supply(shown_driver, port, Limits(current_A=3.0, voltage_V=12.0))
        assert isinstance(supply, PowerSupply)
        assert supply.identify().text == "OUR LAB, BENCH SUPPLY, 0, 1.0"
        supply.set_voltage(12.0)
        supply.set_current(0.7059)
        supply.set_output(True)
        assert supply.output_on()
        assert supply.measure().current_A == pytest.approx(0.705)
        supply.check()
        with pytest.raises(InstrumentError, match=r"2\.5"):
            supply.set_current(2.5)
        supply.safe_off()
        supply.close()
    assert not coil.state.output


def test_the_shown_check_passes_and_reports_a_faulty_driver(shown_driver, monkeypatch):
    emulated = ModuleType("bench_supply_emulated")
    emulated.BenchDialect = BenchDialect
    monkeypatch.setitem(sys.modules, "bench_supply_emulated", emulated)
    (lines,) = [block for block in blocks("python") if "check_supply" in block]
    exec(lines, {})
    emulated.BenchDialect = Nonsense
    with pytest.raises(AssertionError, match="the supply driver BenchSupply: says_who_it_is: ReplyNotUnderstood"):
        exec(lines, {})


class Nonsense:
    # An emulated supply that answers every query with an empty line.

    def __init__(self, supply: CoilSupply) -> None:
        pass

    def receive(self, data: bytes) -> bytes:
        return b"\n"


def test_the_driver_in_the_documentation_refuses_unreadable_answers(shown_driver):
    with serve_pty(Nonsense(CoilSupply(WallClock()))) as port:
        supply = open_supply(shown_driver, port, Limits(current_A=3.0, voltage_V=12.0))
        for act in (supply.identify, supply.measure, supply.output_on):
            with pytest.raises(ReplyNotUnderstood):
                act()
        supply.close()


def test_announced_drivers_are_listed_with_those_of_this_package(shown_driver, monkeypatch):
    assert shown_driver in SUPPLIES
    assert list(SUPPLIES)[-1] == shown_driver
    assert len(SUPPLIES) == len(list(SUPPLIES))
    monkeypatch.setattr(discovery, "list_basler_cameras", tuple)
    assert any(shown_driver in note for note in discovery.discover().notes)


def test_a_driver_that_cannot_be_imported_is_named_with_the_reason(monkeypatch, tmp_path):
    install(tmp_path, "eimi_drivers.supplies", {"lost": "no_such_module:Supply"})
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(InstrumentError, match=r"'lost' is announced as no_such_module:Supply .* cannot be imported"):
        open_supply("lost", "somewhere", Limits(1.0, 12.0))


def test_a_driver_of_another_package_cannot_replace_one_of_this_package(monkeypatch, tmp_path):
    driver = SUPPLIES["korad"]
    install(tmp_path, "eimi_drivers.supplies", {"korad": "no_such_module:Supply"})
    monkeypatch.syspath_prepend(str(tmp_path))
    assert SUPPLIES["korad"] is driver
    assert list(SUPPLIES).count("korad") == 1


def test_camera_drivers_are_announced_in_the_same_way(monkeypatch, tmp_path):
    (tmp_path / "pinhole.py").write_text(
        "from types import SimpleNamespace\n\n"
        "def open_pinhole(source, settings):\n"
        "    return SimpleNamespace(identify=lambda: source, flush=None, grab=lambda timeout_s: None, close=dict)\n"
    )
    install(tmp_path, "eimi_drivers.cameras", {"pinhole": "pinhole:open_pinhole"})
    monkeypatch.syspath_prepend(str(tmp_path))
    assert "pinhole" in CAMERAS
    with pytest.raises(UnusableDriver, match=r"\(pinhole.open_pinhole\) .*: flush is None, but should be flush\(\)"):
        open_camera("pinhole", "box 3")
    path = tmp_path / "pinhole.py"
    path.write_text(path.read_text().replace("flush=None", "flush=lambda: None"))
    sys.modules.pop("pinhole")
    assert open_camera("pinhole", "box 3").identify() == "box 3"
    sys.modules.pop("pinhole")
