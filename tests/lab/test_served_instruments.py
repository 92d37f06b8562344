"""`eimi emulate bench` emulates all instruments of a rig file at their addresses, with one coil for all of them."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_fitting import Magnet, Specimen
from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import load_specimen
from eimi_lab.virtual import beam as beam_module
from eimi_lab.virtual import rod as rod_module
from eimi_lab.virtual import served_bench
from eimi_lab.virtual.raster import coverage
from eimi_lab.virtual.served_bench import ServedBench

REAL = """
name = "my bench"
calibration = "calibration.toml"
camera = { driver = "basler", source = "40012345", region = [16, 8, 160, 128] }
[supply]
driver = "keysight-e36312a"
address = "TCPIP::127.0.0.1::5025::SOCKET#2"
limits = { current_A = 1.0, voltage_V = 9.0 }
[[sensors]]
name = "hall"
driver = "lakeshore-425"
address = "TCPIP::127.0.0.1::7777::SOCKET"
measures = "field"
[[sensors]]
name = "far"
driver = "text-line"
address = "/dev/ttyUSB7"
measures = "specimen_temperature"
"""


@pytest.fixture
def connected(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    # Replace the servers of all instruments; return a dictionary that receives how they were started.
    seen: dict[str, Any] = {"served": []}

    @contextmanager
    def coil_line(coil: Any, port: int) -> Any:
        seen["coil"], seen["coil port"] = coil, port
        yield "coil line"

    @contextmanager
    def camera(shown: Any, size: tuple[int, int], **options: Any) -> Any:
        seen["pictures"], seen["size"], seen["camera options"] = shown.args, size, options
        yield SimpleNamespace(lose_packets=lambda share: seen.update(lost=share), raise_failure="look")

    @contextmanager
    def instrument(responder: Any, port: int | None = None) -> Any:
        seen["served"].append((responder, port))
        yield f"address of {responder}"

    class Session:
        def __init__(self, *arguments: Any, **options: Any) -> None:
            seen["session"], seen["options"] = arguments, options

        def serve(self) -> None:
            seen["has served"] = True

    monkeypatch.setattr(served_bench, "serve_coil", coil_line)
    monkeypatch.setattr(served_bench, "gige_process", camera)
    monkeypatch.setattr(served_bench, "serve_tcp", instrument)
    monkeypatch.setattr(served_bench, "serve_pty", instrument)
    monkeypatch.setattr(served_bench, "EmulatedSession", Session)
    monkeypatch.setattr(
        served_bench, "emulated_instrument", lambda rule, field_mT, clock: seen.update(field=field_mT) or rule.name
    )
    return seen


def test_all_instruments_are_served_with_the_same_coil(connected: dict[str, Any], tmp_path: Path) -> None:
    specimen, said = load_specimen("type1"), []
    (tmp_path / "calibration.toml").write_text(load_rig("virtual").calibration.text)
    (tmp_path / "real.toml").write_text(REAL)
    rig = load_rig(tmp_path / "real.toml")
    bench = ServedBench(rig, specimen, tmp_path / "client.toml", said.append, after_s=3.0, packet_loss=0.25)
    bench.serve()
    assert connected["has served"]
    assert connected["coil"].coil_current_A() == pytest.approx(0.0, abs=0.1)
    assert connected["coil port"] == 0
    assert connected["lost"] == 0.25
    assert connected["size"] == (16 + 160, 8 + 128)
    assert connected["camera options"] == {"address": served_bench.LOOPBACK, "triggers_per_s": 10.0}
    shown_rig, shown_specimen, line = connected["pictures"]
    assert (shown_rig.supply, shown_specimen, line) == (rig.supply, specimen, "coil line")
    assert connected["served"] == [("hall", 7777), ("far", None)]
    driver, port, fault, after_s, say = connected["session"]
    assert (driver, port, fault, after_s) == ("keysight-e36312a", 5025, None, 3.0)
    assert say == said.append
    options = connected["options"]
    assert (options["coil"], options["address"]) == (connected["coil"], rig.supply.address)
    assert options["look"] == "look"
    assert abs(connected["field"]()) < 1.0
    options["announce"]("TCPIP::127.0.0.1::9999::SOCKET", "coil line")
    options["announce"]("TCPIP::127.0.0.1::9998::SOCKET", "coil line")  # the file is replaced
    client = load_rig(tmp_path / "client.toml")
    assert client.supply.address == "TCPIP::127.0.0.1::9998::SOCKET#2"
    assert [sensor.address for sensor in client.sensors] == ["address of hall", "address of far"]
    assert said[0] == (
        f"supply at TCPIP::127.0.0.1::9999::SOCKET#2, GigE camera at {served_bench.LOOPBACK}, hall at address of hall, "
        "far at address of far"
    )
    assert said[1].startswith(f"{tmp_path / 'client.toml'}: the rig of this bench")
    assert len(said) == 4


def test_the_supply_of_the_virtual_rig_speaks_like_a_korad(connected: dict[str, Any], tmp_path: Path) -> None:
    said: list[str] = []
    rig = load_rig("virtual")
    ServedBench(rig, load_specimen("type1"), tmp_path / "client.toml", said.append).serve()
    assert connected["session"][:2] == ("korad", None)
    assert connected["lost"] == 0.0
    assert connected["served"] == []
    connected["options"]["announce"]("/dev/pts/3", "coil line")
    assert load_rig(tmp_path / "client.toml").supply.address == "/dev/pts/3"
    assert "sensors" not in (tmp_path / "client.toml").read_text()
    assert said[0] == f"supply at /dev/pts/3, GigE camera at {served_bench.LOOPBACK}"


def test_a_slanted_body_in_a_wide_and_in_a_high_frame_has_its_area() -> None:
    # The covered area is that of the polygon, and each row has the width of the polygon there.
    slanted = np.array([[2.3, 1.2], [41.7, 5.1], [43.9, 9.3], [4.1, 7.7]])
    x, y = slanted.T
    area = 0.5 * abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))))
    wide = coverage(slanted, (50, 14))
    assert wide.sum() == pytest.approx(area)
    assert coverage(slanted[:, ::-1], (14, 50)) == pytest.approx(wide.T)
    fine = np.kron(wide, np.ones((1, 1)))
    inside = coverage(4.0 * (slanted + 0.5) - 0.5, (200, 56)).reshape(14, 4, 50, 4).mean(axis=(1, 3))
    assert fine == pytest.approx(inside, abs=1e-9)
    assert wide.max() <= 1.0
    cut = coverage(slanted - np.array([20.0, 3.0]), (30, 5))
    assert cut == pytest.approx(wide[3:8, 20:50])


def test_the_solid_is_solved_up_to_a_quarter_of_the_field_if_it_has_no_equilibrium_before(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    reached: list[float] = []
    limit = 2.0

    class Beside:
        def solve(self, law: Any, values: Any, loads: Any) -> Any:
            reached.append(loads[-1])
            assert len(loads) == 17
            assert loads[0] == 0.0
            by_turn = "effect" if loads[-1] <= limit else None
            return SimpleNamespace(effect=SimpleNamespace(by_turn=by_turn))

    monkeypatch.setattr(beam_module, "_model", lambda specimen, mesh: Beside())
    specimen = Specimen(30.0, 3.0, 5.0, 1070.0, section="solid", magnet=Magnet(4.0, 3.0, 2.0, 1.2, 7500.0))
    virtual_loads: Any = SimpleNamespace(at=list)
    solved = beam_module._solved.__wrapped__
    _, effect, reach_mT = solved(specimen, "neo-hookean", (5e4,), (4, 1, 1), virtual_loads, 6.0)
    assert reached == [6.0, 3.0, 1.5]
    assert (effect.by_turn, reach_mT) == ("effect", 1.5)
    limit = 1.0
    assert solved(specimen, "neo-hookean", (5e4,), (4, 1, 1), virtual_loads, 6.0)[1:] == (None, 0.0)
    assert reached[3:] == [6.0, 3.0, 1.5]


def test_a_rod_of_a_solid_without_an_equilibrium_gets_no_softening(monkeypatch: pytest.MonkeyPatch) -> None:
    # Under the large torque there is no equilibrium, and no softening; under a small load the rod is refused.
    specimen = Specimen(30.0, 3.0, 5.0, 1070.0, section="solid", magnet=Magnet(4.0, 3.0, 2.0, 1.2, 7500.0))
    tips = {"force": 1.1e-3, "small": 1.0e-3, "large": None}
    asked: list[str] = []

    class Model:
        def __init__(self, *arguments: Any) -> None:
            pass

        def solve(self, law: Any, values: Any, loads: Any, tolerance_mm: float) -> Any:
            assert tolerance_mm == 1e-8
            field = float(np.abs(np.asarray(loads.field_T)).max())
            name = "force" if field == 0.0 else "small" if field < 1e-4 else "large"
            asked.append(name)
            return SimpleNamespace(converged=[tips[name] is not None], name=name)

        def tip_angle_deg(self, shapes: Any) -> np.ndarray:
            return np.degrees(np.array([[tips[shapes.name]]]))

    monkeypatch.setattr(rod_module, "SolidBeside", Model)
    found = rod_module.stiffness_of_solid(specimen, "neo-hookean", (5e4,), (4, 1, 1))
    assert sorted(asked) == ["force", "large", "small"]
    assert found.softening_m2 == 0.0
    assert found.by_strain == pytest.approx(-3.0, abs=1e-3)
    assert 0.02 < found.length_m < 0.04
    for missing in ("small", "force"):
        kept, tips[missing] = tips[missing], None
        with pytest.raises(ArithmeticError, match="no equilibrium of the virtual beam"):
            rod_module.stiffness_of_solid(specimen, "neo-hookean", (5e4,), (4, 1, 1))
        tips[missing] = kept
