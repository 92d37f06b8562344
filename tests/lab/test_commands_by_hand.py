# Every command passes its arguments on, and prints and returns what the called function returns.

from __future__ import annotations

import inspect
import signal
from collections.abc import Callable
from dataclasses import dataclass, fields
from datetime import date
from itertools import chain
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import typer

from eimi_lab import cli
from eimi_lab.commands import (
    beginning,
    bench,
    images,
    material_laws,
    next_run,
    publishing,
    showing,
    studying,
    trying,
    watching,
)
from eimi_lab.commands.motion_options import MotionOptions
from eimi_lab.commands.picture_options import PictureOptions, _numbers, _points
from eimi_lab.commands.result import Result, printing
from eimi_lab.commands.track_options import ImportOptions
from eimi_lab.fits.options import FitOptions
from eimi_lab.process.errors import InputError

ACCEPTED = Path(__file__).parent / "accepted" / "commands.txt"


def described_command(command: Callable[..., Any]) -> list[str]:
    # Return a line for each argument of a command: its names, default, range, and whether it is hidden.
    lines = []
    for name, parameter in inspect.signature(command, eval_str=True).parameters.items():
        *_, option = getattr(parameter.annotation, "__metadata__", (SimpleNamespace(),))
        words = [f"{command.__name__} {'/'.join([name, *(getattr(option, 'param_decls', None) or ())])}"]
        default = parameter.default
        words += ["required" if default is parameter.empty else f"default {str(default) if default != '' else 'empty'}"]
        ends = (getattr(option, "min", None), getattr(option, "max", None))
        words += [f"from {ends[0]} to {ends[1]}"] if ends != (None, None) else []
        words += ["hidden"] * bool(getattr(option, "hidden", False)) + ["eager"] * bool(
            getattr(option, "is_eager", False)
        )
        lines.append(", ".join(words))
    return lines


def test_the_arguments_of_every_command_are_as_accepted(tmp_path: Path) -> None:
    lines = [line for command in chain.from_iterable(cli.GROUPS.values()) for line in described_command(command)]
    (tmp_path / ACCEPTED.name).write_text("\n".join(lines) + "\n", encoding="utf-8")
    accepted = ACCEPTED.read_text(encoding="utf-8").splitlines() if ACCEPTED.exists() else []
    assert lines == accepted, f"the new description is {tmp_path / ACCEPTED.name}"


def test_acquire_passes_everything_on(called: Any) -> None:
    chosen = SimpleNamespace(currents_A=(0.0, 0.1, 0.2))
    called("eimi_lab.config.protocol.load_protocol", chosen)
    called("eimi_lab.config.specimen.load_specimen", "beam")
    called("eimi_lab.config.rig.load_rig", "rig")
    calls = called("eimi_lab.face.acquiring.run_protocol", "stored.h5")
    called("eimi_lab.face.acquiring.dry_steps", (["short"], ["whole", "list"]))
    result = bench.acquire("p", "s", "r", Path("o.h5"), resume=True, note="n", transcript=Path("t"))
    assert result == Result(["stored.h5: 3 states"], {"dataset": "stored.h5", "states": 3})
    assert [arguments for _, arguments, _ in calls[:3]] == [("p",), ("s",), ("r",)]
    assert calls[3] == (
        "run_protocol",
        (chosen, "beam", "rig", Path("o.h5")),
        {
            **{"resume": True, "take_over": False, "note": "n", "transcript": Path("t")},
            **{"events": False, "force": False, "watched_by": None},
        },
    )
    result = bench.acquire("p", "s", "r", Path("o.h5"), take_over="take", events="send", force="force")  # type: ignore[arg-type]
    assert result.lines == []
    assert calls[-1][2] | {"note": "", "transcript": None, "resume": False} == calls[-1][2]
    assert (calls[-1][2]["take_over"], calls[-1][2]["events"], calls[-1][2]["force"]) == ("take", "send", "force")
    assert bench.acquire("p", "s", "r", dry_run=True) == Result(["short"], {"dry_run": ["whole", "list"]})
    assert bench.acquire("p", "s", "r", dry_run=True, verbose=True).lines == ["whole", "list"]
    for wrong, words in (
        ({"dry_run": True, "events": True}, "--events: --dry-run starts no run"),
        ({"verbose": True, "output": Path("o.h5")}, "-v: is only for --dry-run"),
        ({}, r"-o FILE.h5 is missing"),
    ):
        with pytest.raises(InputError, match=words):
            bench.acquire("p", "s", "r", **wrong)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="p"):
        bench.acquire("p", "s", "r", Path("p"))


def test_a_run_of_the_page_heeds_ctrl_c_again(called: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    handlers: list[Any] = []
    monkeypatch.setattr(signal, "signal", lambda *handler: handlers.append(handler))
    for path in ("protocol.load_protocol", "specimen.load_specimen", "rig.load_rig"):
        called(f"eimi_lab.config.{path}", SimpleNamespace(currents_A=(0.0,)))
    called("eimi_lab.face.acquiring.run_protocol", "o")
    bench.acquire("p", "s", "r", Path("o.h5"))
    assert handlers == []
    bench.acquire("p", "s", "r", Path("o.h5"), watched_by="3,4,5")
    assert handlers == [(signal.SIGINT, signal.default_int_handler)]


def test_instruments_lists_what_was_found(monkeypatch: pytest.MonkeyPatch, called: Any) -> None:
    @dataclass
    class Found:
        kind: str
        driver: str
        address: str
        text: str

    found = (Found("supply", "korad", "/dev/x", "a port"),)
    calls = called("eimi_drivers.discovery.discover", SimpleNamespace(found=found, notes=("slow",)))
    result = bench.instruments()
    assert result.lines == ["supply: driver = korad, address or source = /dev/x (a port)", "note: slow"]
    assert result.content == {"found": [vars(found[0])], "notes": ("slow",)}
    called("eimi_drivers.discovery.discover", SimpleNamespace(found=(), notes=()))
    assert bench.instruments().lines == [
        "no supply and no camera was found; `eimi emulate korad` starts an emulated supply"
    ]
    for given in (
        {"driver": "korad"},
        {"address": "x"},
        {"who": "me"},
        {"output": Path("o")},
        {"yes": True},
    ):
        with pytest.raises(InputError, match="are only for --try"):
            bench.instruments(**given)  # type: ignore[arg-type]
    called("eimi_lab.commands.trying.try_one_supply", "tried")
    assert bench.instruments("korad", "x", True, "me", Path("o"), True) == "tried"
    assert calls[-1][1] == ("korad", "x", "me", Path("o"), True)


class Session:
    # A replacement for the sessions of emulated instruments.

    made: list[Any] = []  # noqa: RUF012

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        say = next(one for one in arguments if callable(one))
        say("words")
        self.made.append(([one for one in arguments if one is not say], keywords))

    def serve(self) -> None:
        self.made.append("served")


@pytest.fixture
def sessions(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    Session.made = []
    for path in (
        "eimi_drivers.emulators.session.EmulatedSession",
        "eimi_drivers.emulators.sensor_session.EmulatedSensorSession",
        "eimi_lab.virtual.served_bench.ServedBench",
    ):
        monkeypatch.setattr(path, Session)
    return Session.made


def test_emulate_serves_a_supply_a_sensor_or_a_bench(
    sessions: list[Any], called: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from eimi_drivers.emulators.faults import Fault
    from eimi_drivers.emulators.sensors import SensorFault
    from eimi_drivers.emulators.session import OPEN_OHM

    bench.emulate("korad")
    assert sessions == [(["korad", None, None, 5.0], {"coil": None}), "served"]
    assert capsys.readouterr().out == "words\n"
    sessions.clear()
    bench.emulate("scpi", None, 5025, "slow", 7.5, without_coil=True)
    ((arguments, keywords), _) = sessions
    assert arguments == ["scpi", 5025, Fault.SLOW, 7.5]
    assert keywords["coil"]._cold_ohm == OPEN_OHM
    sessions.clear()
    with pytest.raises(InputError, match="SUPPLY = 'nonesuch' should be one of korad, "):
        bench.emulate("nonesuch")
    with pytest.raises(InputError, match="--fault = 'jump' should be one of silence"):
        bench.emulate("korad", fault="jump")
    with pytest.raises(InputError, match="--fault = 'slowly': should be one of"):
        bench.emulate("text-line", fault="slowly")
    with pytest.raises(InputError, match="are only for `eimi emulate bench`; leave them out for 'korad'"):
        bench.emulate("korad", "rig")
    with pytest.raises(InputError, match="are only for `eimi emulate bench`"):
        bench.emulate("korad", specimen="s")
    for instrument, option, given in (
        ("korad", "--coil", {"coil": "c"}),
        ("korad", "--mT-per-A", {"mT_per_A": 3.0}),
        ("korad", "--offset-mT", {"offset_mT": -3.0}),
        ("korad", "--packet-loss", {"packet_loss": 0.5}),
        ("korad", "--output", {"output": Path("rig.toml")}),
        ("text-line", "--force", {"force": True}),
        ("text-line", "--packet-loss", {"packet_loss": 0.5}),
        ("text-line", "--without-coil", {"without_coil": True}),
        ("bench", "--tcp", {"tcp": 0}),
        ("bench", "--without-coil", {"without_coil": True}),
        ("bench", "--coil", {"coil": "c"}),
    ):
        with pytest.raises(InputError, match=f"^{option}: is not used by `eimi emulate {instrument}`; leave it out"):
            bench.emulate(instrument, **given)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"^--after 3: is only used with --fault; leave it out"):
        bench.emulate("korad", after=3.0)
    assert sessions == []
    with pytest.raises(InputError):  # a real session of a sensor never ends
        bench.emulate("text-line", None, 1, "jump", 2.0, coil="c", mT_per_A=3.0, offset_mT=4.0)
    assert sessions == [(["text-line", 1, "c", 3.0, 4.0, SensorFault.JUMP, 2.0], {}), "served"]
    sessions.clear()
    called("eimi_lab.config.rig.load_rig", lambda name: f"rig {name}")
    called("eimi_lab.config.specimen.load_specimen", lambda name: f"beam {name}")
    output = tmp_path / "bench.toml"
    for given in ({"rig": "r"}, {"specimen": "s"}, {}):
        with pytest.raises(InputError, match="RIG or --specimen is missing"):
            bench.emulate("bench", output=output, **given)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="--fault = 'jump' should be one of silence"):
        bench.emulate("bench", "r", specimen="s", fault="jump", output=output)
    bench.emulate("bench", "r", None, "drift", 1.5, specimen="s", output=output, packet_loss=0.25, force=True)
    bench.emulate("bench", "r", specimen="s", output=output)
    assert [keywords for _, keywords in sessions[::2]] == [
        {"force": True, "fault": Fault.DRIFT, "after_s": 1.5, "packet_loss": 0.25},
        {"force": False, "fault": None, "after_s": 5.0, "packet_loss": 0.0},
    ]
    assert sessions[0][0] == ["rig r", "beam s", output]
    output.write_text("x")
    with pytest.raises(InputError, match="exists"):
        bench.emulate("bench", "r", specimen="s", output=output)


def test_the_faults_are_listed_on_request(capsys: pytest.CaptureFixture[str]) -> None:
    bench._list_faults(False)
    assert capsys.readouterr().out == ""
    with pytest.raises(typer.Exit):
        bench._list_faults(True)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 19
    assert lines[0].startswith("silence: every message is lost and nothing answers. A correct program stops waiting")
    assert lines[-1].startswith("jump: the value is a hundred times too large. A correct program ends the run")


def test_the_calibration_of_a_coil_is_printed_and_written(called: Any, tmp_path: Path) -> None:
    line = SimpleNamespace(
        **{"probe": "gauss", "in_words": "4.7 mT/A", "scatter_mT": 0.0123, "shared_is_stated": False},
        **{"mT_per_A": 4.7, "mT_per_A_sigma": 0.1, "offset_mT": 0.3, "offset_mT_sigma": 0.02},
    )
    measured = SimpleNamespace(
        current_A=np.array([0.0, 0.5]), field_mT=np.array([0.3, 2.65]), line=line, hysteresis_mT=0.0456
    )
    rig = SimpleNamespace(calibration=SimpleNamespace(mT_per_A=5.1))
    called("eimi_lab.config.rig.load_rig", rig)
    calls = called("eimi_lab.acquisition.coil_calibration.calibrate_coil", measured)
    called("eimi_lab.acquisition.coil_calibration.calibration_currents", "currents")
    called("eimi_lab.acquisition.coil_calibration.with_measured_coil", SimpleNamespace(text="new = 1\n"))
    output = tmp_path / "c.toml"
    result = bench.calibrate_coil("r", output)
    assert output.read_text() == "new = 1\n"
    assert result.lines == [
        "       0 A        0.3 mT",
        "     0.5 A       2.65 mT",
        "at the magnet, measured with gauss: 4.7 mT/A; the calibration of the rig has 5.1 mT/A",
        "the standard deviation of the readings from the fitted straight line is 0.012 mT; readings with increasing "
        "and with decreasing current differ by at most 0.046 mT",
        "the scale of the gaussmeter is assumed to be exact, because its table in the rig file has no "
        "uncertainty_share",
        f"{output}: the calibration with the measured field of the coil",
    ]
    assert result.content == {
        **{"calibration": output, "coil_constant_mT_per_A": 4.7, "coil_constant_sigma_mT_per_A": 0.1},
        **{"offset_mT": 0.3, "offset_sigma_mT": 0.02, "current_A": [0.0, 0.5], "field_mT": [0.3, 2.65]},
    }
    by_name = {name: arguments for name, arguments, _ in calls}
    assert by_name["calibration_currents"] == (rig, None, 6)
    assert by_name["calibrate_coil"][:2] == (rig, "currents")
    assert by_name["with_measured_coil"][:2] == (rig.calibration, measured)
    assert isinstance(by_name["with_measured_coil"][2], date)
    with pytest.raises(InputError, match="exists"):
        bench.calibrate_coil("r", output)
    line.shared_is_stated = True
    assert len(bench.calibrate_coil("r", output, 0.7, 9, force=True).lines) == 5
    assert calls[-3][1] == (rig, 0.7, 9)


def test_recover_and_publish_say_what_they_wrote(called: Any, capsys: pytest.CaptureFixture[str]) -> None:
    calls = called("eimi_lab.dataset.recovery.recover", 4)
    assert bench.recover(Path("a"), Path("b"), True) == Result(["b: 4 states"], {"dataset": Path("b"), "states": 4})
    assert calls[-1][1] == (Path("a"), Path("b"), True)
    files = [
        SimpleNamespace(place=Path(n), size_bytes=size, sha256=n) for n, size in (("x", 1_250_000), ("y", 2_300_000))
    ]
    called("eimi_lab.publishing.archive.publish", SimpleNamespace(files=files, remarks=["no licence"]))
    called("eimi_lab.config.people.load_people", "authors")
    result = publishing.publish([Path("r")], Path("o.eln"), "t", Path("p"), "l", True)
    assert result.lines == ["o.eln: 2 files, 3.5 MB; every SHA-256 hash was checked"]
    assert result.content["files"] == [
        {"place": "x", "size_bytes": 1_250_000, "sha256": "x"},
        {"place": "y", "size_bytes": 2_300_000, "sha256": "y"},
    ]
    assert (result.content["archive"], result.content["remarks"]) == (Path("o.eln"), ["no licence"])
    keywords = {"title": "t", "people": "authors", "licence": "l", "force": True}
    assert calls[-1] == ("publish", ([Path("r")], Path("o.eln")), keywords)
    assert "o.eln: no licence" in capsys.readouterr().err
    publishing.publish([Path("r")], Path("o.eln"))
    assert calls[-1][2] == {"title": None, "people": None, "licence": None, "force": False}


def test_fit_prints_each_fit_with_its_remarks(called: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    from eimi_lab.fits import fit_summary, records, time_records

    class Bending:
        def __init__(self, name: str, time: Any) -> None:
            self.name, self.time = name, time
            self.datasets = [
                SimpleNamespace(in_words=lambda: "a.h5: 3 states"),
                SimpleNamespace(in_words=lambda: f"{name}.h5"),
            ]

        def summary(self) -> str:
            return f"{self.name}: modulus"

    class Ringing(Bending):
        pass

    monkeypatch.setattr(records, "FitRecord", Bending)
    monkeypatch.setattr(time_records, "RingDownRecord", Ringing)
    monkeypatch.setattr(fit_summary, "remarks", lambda record: [f"remark on {record.name}"])
    monkeypatch.setattr(time_records, "time_lines", lambda time: [f"head of {time}", f"rest of {time}"])
    monkeypatch.setattr(fit_summary, "comparison_table", lambda comparison: [f"compared {comparison}"])
    monkeypatch.setattr(fit_summary, "evidence_remarks", lambda evidence: [f"seen {evidence}"])

    class Content(list[Any]):
        comparison = "laws"

        def model_dump(self, mode: str) -> dict[str, str]:
            return {"mode": mode}

    ringing: Any = type("Alone", (), {})()
    ringing.datasets, ringing.time, ringing.name = [SimpleNamespace(in_words=lambda: "ring.h5")], "t2", "ring"
    ringing.summary = lambda: "ring: frequency"
    monkeypatch.setattr(time_records, "RingDownRecord", type(ringing))
    content = Content([Bending("one", None), Bending("two", "t1"), ringing])
    calls = called("eimi_lab.face.identifying.identify_laws", (content, "data"))
    options = FitOptions()
    files: dict[str, Any] = {"datasets": [Path("a")], "model": ["yeoh"], "output": Path("o")}
    files |= {one.name: getattr(options, one.name) for one in fields(options)}
    result = material_laws.fit(**files)
    assert result.lines == [
        *("a.h5: 3 states", "one.h5", "two.h5", "one: modulus", "  remark on one"),
        *("two: modulus", "  remark on two", "  head of t1", "  rest of t1"),
        *("ring.h5", "ring: frequency", "  rest of t2", "compared laws", "seen data"),
    ]
    assert result.content == {"mode": "json"}
    keywords = {
        **{"seeds": [1], "each": False, "bootstrap": 0, "workers": 1, "scheduler": None, "checkpoint": None},
        **{"resume": False, "output": Path("o"), "force": False},
    }
    assert calls[-1] == ("identify_laws", ([Path("a")], ["yeoh"], options), keywords)
    given = {
        **{"each": "each", "bootstrap": 7, "workers": 3, "scheduler": "tcp://x", "checkpoint": Path("c")},
        **{"resume": "resume", "force": "force"},
    }
    material_laws.fit(**files, seed=[4, 5], **given)  # type: ignore[arg-type]
    assert calls[-1][2] == {**given, "seeds": [4, 5], "output": Path("o")}


def test_validate_and_tensile_print_their_tables(called: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    from eimi_lab.fits import fit_summary, tensile_record, validation_tables

    class Judged(list[Any]):
        evidence, content = "data", {"validations": 1}

    calls = called("eimi_lab.face.using.validate", Judged(["v"]))
    monkeypatch.setattr(validation_tables, "by_dataset", lambda rows: [f"datasets {rows}"])
    monkeypatch.setattr(validation_tables, "by_state", lambda rows: [f"states {rows}"])
    monkeypatch.setattr(validation_tables, "matrix", lambda rows: [f"matrix {rows}"])
    monkeypatch.setattr(fit_summary, "evidence_remarks", lambda evidence: [f"seen {evidence}"])
    one = material_laws.validate([Path("a")], [Path("f")], Path("o"))
    assert one == Result(["datasets ['v']", "seen data"], {"validations": 1})
    keywords = {"section": None, "include_flagged": False, "output": Path("o"), "force": False}
    assert calls[-1] == ("validate", ([Path("a")], [Path("f")]), keywords)
    two = material_laws.validate([Path("a"), Path("b")], [], Path("o"), "solid", "flagged", True, "force")  # type: ignore[arg-type]
    assert two.lines == ["datasets ['v']", "states ['v']", "matrix ['v']", "seen data"]
    assert calls[-1][2] == {"section": "solid", "include_flagged": "flagged", "output": Path("o"), "force": "force"}

    class Curve:
        def summary(self) -> str:
            return "a curve"

    monkeypatch.setattr(tensile_record, "TensileRecord", Curve)
    monkeypatch.setattr(fit_summary, "tensile_remarks", lambda record: ["of one kind"])

    class Fits(list[Any]):
        def model_dump(self, mode: str) -> dict[str, str]:
            return {"mode": mode}

    called("eimi_lab.face.identifying.tensile", Fits([Curve()]))
    assert material_laws.tensile(Path("c"), ["yeoh"], Path("o")) == Result(
        ["a curve", "  of one kind"], {"mode": "json"}
    )
    keywords = {"window": ("20", "50", "100", "full"), "relative": False, "output": Path("o"), "force": False}
    assert calls[-1] == ("tensile", (Path("c"), ["yeoh"]), keywords)
    material_laws.tensile(Path("c"), ["yeoh"], Path("o"), ["30"], "relative", "force")  # type: ignore[arg-type]
    assert calls[-1][2] == {"window": ["30"], "relative": "relative", "output": Path("o"), "force": "force"}


def test_export_prints_or_writes_the_card_with_its_caveats(
    called: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    calls = called(
        "eimi_lab.face.using.card_of", ("*CARD\n\n", SimpleNamespace(caveats=lambda: ["of no use", "at all"]))
    )
    fits, output = tmp_path / "fits.json", tmp_path / "card.inp"
    assert material_laws.export(fits, "yeoh", "abaqus") == Result(["*CARD\n"], {"card": "*CARD\n\n"})
    assert calls[-1][1] == (fits, "yeoh", "abaqus", None, None, None)
    told = capsys.readouterr().err
    assert f"{fits}: yeoh: of no use" in told
    assert f"{fits}: yeoh: at all" in told
    result = material_laws.export(fits, "yeoh", "sofa", output, 2, 30.0, 40.0)
    assert result == Result([output], {"card": "*CARD\n\n", "file": output})
    assert calls[-1][1] == (fits, "yeoh", "sofa", 2, 30.0, 40.0)
    assert output.read_text() == "*CARD\n\n"
    with pytest.raises(InputError, match="exists"):
        material_laws.export(fits, "yeoh", "sofa", output)
    material_laws.export(fits, "yeoh", "sofa", output, force=True)
    with pytest.raises(InputError, match=r"fits\.json"):
        material_laws.export(fits, "yeoh", "sofa", fits, force=True)


TIPS = np.arange(18.0).reshape(2, 3, 3)[:, :, :2]


@pytest.mark.parametrize(
    ("tips", "words", "remarks"),
    [
        (TIPS, " [15.00, 16.00]", ()),
        (None, "", ()),
        (np.where([[[True]], [[False]]], TIPS, np.nan), "", ("no interval",)),
    ],
)
def test_simulate_says_where_the_tip_is(called: Any, tips: Any, words: str, remarks: tuple[str, ...]) -> None:
    angle_deg, field_mT = np.array([1.0, 2.345]), np.array([0.0, 3.0])
    result = SimpleNamespace(tips=tips, tip_angle_deg=angle_deg, field_mT=field_mT, remarks=remarks)
    calls = called("eimi_lab.face.using.simulate", result)
    done = material_laws.simulate("p", "s", "yeoh", Path("o"))
    assert done.lines == [*remarks, f"o: 2 states, tip at {2.345:.2f}{words} degrees"]
    content = {"folder": Path("o"), "field_mT": [0.0, 3.0], "tip_angle_deg": [1.0, 2.345], "told": list(remarks)}
    assert done.content == content
    defaults = {
        **{
            "parameter": (),
            "fit": None,
            "index": None,
            "coil_constant": 4.7,
            "gravity_angle": 0.0,
            "field_angle": 90.0,
        },
        **{"bulk_modulus_kPa": None, "output": Path("o"), "force": False},
    }
    assert calls[-1] == ("simulate", ("p", "s", "yeoh"), defaults)
    given: dict[str, Any] = {
        **{"parameter": ["mu_Pa=1"], "fit": Path("f"), "index": 2, "coil_constant": 5.0, "gravity_angle": 6.0},
        **{"field_angle": 7.0, "bulk_modulus_kPa": 8.0, "force": True},
    }
    material_laws.simulate("p", "s", "yeoh", Path("o"), **given)
    assert calls[-1][2] == {**given, "output": Path("o")}


def test_plan_and_discover_pass_everything_on(called: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    from eimi_lab.fits import discovering, planning

    monkeypatch.setattr(planning, "table", lambda goal, runs: [f"{goal} {runs}"])
    monkeypatch.setattr(planning, "content", lambda goal, runs: {goal: runs})
    calls = called("eimi_lab.face.using.plan", SimpleNamespace(goal="modulus", runs="runs"))
    result = next_run.plan(Path("f"), "p", ["s"], "r", Path("o"))
    assert result == Result(["modulus runs", Path("o")], {"modulus": "runs"})
    defaults = {
        **{"states": None, "goal": "modulus", "model": None, "gravity_angle": (), "tip_weight": ()},
        **{"both_polarities": False, "output": Path("o"), "force": False},
    }
    assert calls[-1] == ("plan", (Path("f"), "p", ["s"], "r"), defaults)
    next_run.plan(Path("f"), "p", ["s"], "r", Path("o"), 4, "mu", "yeoh", [90.0], [1.0], "both", "force")  # type: ignore[arg-type]
    assert calls[-1][2] == {
        **{"states": 4, "goal": "mu", "model": "yeoh", "gravity_angle": [90.0], "tip_weight": [1.0]},
        **{"both_polarities": "both", "output": Path("o"), "force": "force"},
    }
    monkeypatch.setattr(discovering, "lines", lambda discovery, output: [f"{discovery} in {output}"])
    called("eimi_lab.face.discovering.discover", SimpleNamespace(discovery="terms", content={"t": 1}))
    assert studying.discover([Path("a")], Path("o")) == Result(["terms in o"], {"t": 1})
    defaults = {
        **{"tensile": (), "tensile_window": "full", "term": (), "most_terms": 3, "lot": 0.02, "section": None},
        **{"include_flagged": False, "seed": 1, "output": Path("o"), "force": False},
    }
    assert calls[-1] == ("discover", ([Path("a")],), defaults)
    given: dict[str, Any] = {
        **{"tensile": [Path("t")], "tensile_window": "50", "term": ["i1"], "most_terms": 2, "lot": 0.1},
        **{"section": "solid", "include_flagged": "flagged", "seed": 5, "force": "force"},
    }
    studying.discover([Path("a")], Path("o"), **given)
    assert calls[-1][2] == {**given, "output": Path("o")}


@pytest.mark.parametrize(
    ("workers", "datasets", "fits", "shared"),
    [(None, 9, 1, 4), (None, 2, 1, 2), (3, 9, 1, 3), (3, 2, 1, 2), (3, 9, 0, 1)],
)
def test_a_report_has_as_many_workers_as_it_can_use(
    called: Any, monkeypatch: pytest.MonkeyPatch, workers: int | None, datasets: int, fits: int, shared: int
) -> None:
    from contextlib import nullcontext

    monkeypatch.setattr(showing.sys, "argv", ["/bin/eimi", "report", "a b.h5"])
    calls = called("eimi_lab.process.workers.executor_for", "made")
    called("eimi_lab.process.workers.started", nullcontext("workers"))
    called("eimi_lab.reporting.page.write_report")
    paths = [Path(f"{k}.h5") for k in range(datasets)]
    laws = [Path("fits.json")] * fits or None
    result = showing.report(paths, Path("o.html"), laws, workers=workers)
    assert result == Result([Path("o.html")], {"report": Path("o.html"), "assets": None})
    assert calls[0] == ("executor_for", (shared, None), {})
    assert calls[1] == ("started", ("made", shared, "eimi_lab.fits.prediction"), {})
    keywords = calls[2][2]
    assert calls[2][1] == (Path("o.html"), paths, laws or [])
    assert keywords["command"] == "eimi report 'a b.h5'"
    assert (keywords["force"], keywords["assets"], keywords["executor"]) == (False, None, "workers")
    result = showing.report(paths, Path("o.html"), laws, Path("figures"), force=True)
    assert result == Result([Path("o.html"), Path("figures")], {"report": Path("o.html"), "assets": Path("figures")})
    assert (calls[-1][2]["force"], calls[-1][2]["assets"]) == (True, Path("figures"))


def test_the_demonstration_compares_each_fit_with_the_truth(called: Any) -> None:
    fit = SimpleNamespace(
        datasets=[SimpleNamespace(in_words=lambda: "d.h5: 3 states")], summary=lambda: "a fit", content=lambda: {"f": 1}
    )
    scores = [SimpleNamespace(fit=fit, truth_Pa=45678.9, difference_percent=value) for value in (1.234, -0.5)]
    done = SimpleNamespace(
        **{"true_model": "yeoh", "true_parameters": {"C10_Pa": 1.5, "C20_Pa": -2.0}, "scores": scores},
        **{"dataset": Path("d.h5"), "fits": Path("f.json"), "report": Path("r.html")},
    )
    calls = called("eimi_lab.face.demonstrating.demonstrate", done)
    result = showing.demo()
    assert result.lines == [
        "truth: yeoh, C10_Pa 1.5, C20_Pa -2; initial shear modulus 45679 Pa",
        *("d.h5: 3 states", "a fit; +1.23 % from the truth", "a fit; -0.50 % from the truth"),
        *(Path("d.h5"), Path("f.json"), Path("r.html")),
    ]
    assert result.content == {
        "truth": {"model": "yeoh", "parameters": done.true_parameters, "shear_modulus_Pa": 45678.9},
        "fits": [{"f": 1, "difference_percent": 1.234}, {"f": 1, "difference_percent": -0.5}],
        "files": {"dataset": Path("d.h5"), "fits": Path("f.json"), "report": Path("r.html")},
    }
    assert calls[-1][1] == (Path("eimi-demo"), "dragon_skin_10", "type1", "virtual")
    given = {key: calls[-1][2][key] for key in ("quick", "seed", "force")}
    assert given == {"quick": False, "seed": 1, "force": False}


@pytest.mark.parametrize("quick", [True, False])
def test_a_study_writes_its_pages(called: Any, monkeypatch: pytest.MonkeyPatch, quick: bool) -> None:
    from eimi_lab.study import extent, whole_study

    @dataclass
    class Verdict:
        words: str

    inputs = SimpleNamespace(extent="extent", head=lambda: "head")
    made: list[Any] = []
    monkeypatch.setattr(whole_study.StudyInputs, "of", lambda *given: made.append(given) or inputs)
    calls = called("eimi_lab.study.stored_parts.StoredParts.of", "parts")
    called("eimi_lab.study.whole_study.steps", 3)
    called("eimi_lab.study.whole_study.compute_all", "findings")
    called("eimi_lab.study.pages.write_pages", ["a page"])
    called("eimi_lab.study.claims.verdicts", [Verdict("true")])
    result = studying.study(Path("o"), quick, Path("t"), 7, True)
    assert result == Result(["a page"], {"page": Path("o/study.md"), "claims": [{"words": "true"}]})
    assert made == [(extent.QUICK if quick else extent.WHOLE, 7, Path("t"))]
    assert calls[0] == ("of", (Path("o"), "head", True), {})
    assert calls[1] == ("steps", ("extent",), {})
    assert calls[2][1][:2] == (inputs, "parts")
    assert calls[3][1] == (Path("o"), "findings")


@pytest.mark.parametrize("force", [False, True])
def test_init_writes_the_templates_and_a_row_for_each_image(tmp_path: Path, force: bool) -> None:
    folder = tmp_path / "a" / "b"
    result = beginning.init(folder, force)
    names = ["calibration.toml", "protocol.toml", "specimen.toml", "states.csv"]
    assert result == Result([folder / name for name in names], {"files": [folder / name for name in names]})
    assert (folder / "states.csv").read_text() == "frame,current_A\nframe_0.png,\n"
    for name in ("f_10.PNG", "f_9.png", "notes.txt"):
        (folder / name).write_bytes(b"")
    if not force:
        with pytest.raises(InputError, match="exists"):
            beginning.init(folder)
        assert (folder / "states.csv").read_text() == "frame,current_A\nframe_0.png,\n"
        return
    beginning.init(folder, force=True)
    assert (folder / "states.csv").read_text() == "frame,current_A\nf_9.png,\nf_10.PNG,\n"


@pytest.mark.parametrize("browser", [True, False])
def test_the_page_is_served_and_shown(
    called: Any, monkeypatch: pytest.MonkeyPatch, browser: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    import webbrowser
    from contextlib import nullcontext

    shown: list[str] = []
    monkeypatch.setattr(webbrowser, "open", shown.append)
    calls = called("eimi_lab.page.server.check_host")
    called("eimi_lab.page.redirect_file.redirect_file", lambda address: nullcontext(Path("/tmp/x.html")))
    called("eimi_lab.page.server.serve", lambda folder, host, port, say, view: say(f"http://{host}:{port}/{view}"))
    watching.dashboard(Path("f"), 8080, "10.0.0.7", True, browser)
    assert capsys.readouterr() == (
        "http://10.0.0.7:8080/\n",
        "eimi: open this address in a browser on this computer; press Ctrl-C to end the page; a run then ends with the "
        "coil off\n",
    )
    assert shown == ["file:///tmp/x.html"] * browser
    assert calls[0] == ("check_host", ("10.0.0.7", True), {})
    assert calls[1][1][:3] == (Path("f"), "10.0.0.7", 8080)
    watching.phone(Path("g"), 0, browser=browser)
    assert capsys.readouterr().out == "http://127.0.0.1:0/phone\n"
    assert len(shown) == 2 * browser
    assert ("check_host", ("127.0.0.1", False), {}) in calls


def test_the_page_names_a_missing_package(monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "eimi_lab.page.server", None)
    for view, name in (("", "dashboard"), ("phone", "phone")):
        with pytest.raises(InputError, match=f"^eimi {name} needs .*: pip install 'eimi-lab.page.'$"):
            watching._serve(Path(), "h", 0, False, False, view)


def found(*supplies: tuple[str, str, str]) -> Any:
    return SimpleNamespace(found=[SimpleNamespace(kind=k, driver=d, address=a) for k, d, a in supplies])


def test_the_only_supply_is_tried(called: Any) -> None:
    called("eimi_drivers.discovery.discover", found(("camera", "opencv", "0"), ("supply", "korad", "/dev/x")))
    assert trying._only_supply() == ("korad", "/dev/x")
    called("eimi_drivers.discovery.discover", found(("supply", "korad", "a"), ("supply", "scpi", "b")))
    with pytest.raises(InputError, match=r"\(attached supplies: korad at a; scpi at b\)$"):
        trying._only_supply()
    called("eimi_drivers.discovery.discover", found(("supply", "korad or genesys", "a")))
    with pytest.raises(InputError, match=r"\(attached supplies: none\)$"):
        trying._only_supply()


@pytest.mark.parametrize("passed", [True, False])
def test_a_supply_is_tried_without_questions(called: Any, tmp_path: Path, passed: bool, capsys: Any) -> None:
    steps = [
        SimpleNamespace(passed=True, check="it answers", outcome="fine"),
        SimpleNamespace(passed=passed, check="it stops", outcome="so so"),
    ]
    trial = SimpleNamespace(steps=steps, passed=passed)
    calls = called("eimi_lab.acquisition.supply_trial.try_supply", trial)
    called("eimi_lab.acquisition.trial_form.trial_form", "the form")
    report = tmp_path / "r.md"
    lines = [
        "passed: it answers: fine",
        f"{'passed' if passed else 'FAILED'}: it stops: so so",
        f"{report} and {tmp_path / 'r.wire.txt'}: send both files to the project; the transcript contains the serial "
        "number",
    ]
    if passed:
        content = {"passed": True, "report": report, "transcript": tmp_path / "r.wire.txt"}
        assert trying.try_one_supply("korad", "x", None, report, True) == Result(lines, content)
    else:
        with pytest.raises(typer.Exit) as ended:
            trying.try_one_supply("korad", "x", "me", report, True)
        assert ended.value.exit_code == 1
        assert capsys.readouterr().out.splitlines() == lines
    assert calls[0][1][:3] == ("korad", "x", tmp_path / "r.wire.txt")
    calls[0][1][3]()
    assert calls[1][1] == (trial, "" if passed else "me", "not asked", tmp_path / "r.wire.txt")
    assert report.read_text() == "the form"
    with pytest.raises(InputError, match="exists"):
        trying.try_one_supply("korad", "x", None, report, True)


def test_a_trial_without_a_terminal_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trying.sys, "stdin", SimpleNamespace(isatty=lambda: False))
    with pytest.raises(InputError, match="--try asks questions, but there is no terminal"):
        trying.try_one_supply("korad", "x", None, None, False)


@pytest.mark.parametrize("who", [None, "me"])
def test_a_trial_asks_its_questions(
    called: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, who: str | None
) -> None:
    asked: list[str] = []

    def prompt(words: str, **how: Any) -> str:
        asked.append(words)
        return "an answer"

    monkeypatch.setattr(trying.sys, "stdin", SimpleNamespace(isatty=lambda: True))
    monkeypatch.setattr(trying.typer, "prompt", prompt)
    monkeypatch.setattr(trying.typer, "confirm", lambda words, abort: asked.append(f"{words} {abort}"))
    trial = SimpleNamespace(steps=[], passed=True)
    calls = called(
        "eimi_lab.acquisition.supply_trial.try_supply", lambda driver, address, transcript, before: before() or trial
    )
    called("eimi_lab.acquisition.trial_form.trial_form", "the form")
    monkeypatch.setattr(trying, "_only_supply", lambda: ("scpi", "there"))
    monkeypatch.chdir(tmp_path)
    trying.try_one_supply("korad", None, who, None, False)
    assert calls[0][1][:2] == ("scpi", "there")
    assert calls[1][1][1:3] == (who or "an answer", "an answer")
    first, *questions = asked
    assert first == "Is everything disconnected from the output of this supply? True"
    assert [words.split()[0] for words in questions] == [*(["Who"] if who is None else []), "The", "What"]
    assert [path.name[:14] for path in tmp_path.iterdir()] == ["tried_on_scpi_"]


def test_segment_counts_flagged_and_unusable_states(called: Any) -> None:
    from contextlib import nullcontext

    from eimi_lab.vision.check import Severity

    def edges(*severities: Severity) -> Any:
        return SimpleNamespace(flags=[SimpleNamespace(severity=s, name=str(s)) for s in severities])

    sets = [edges(), edges(Severity.NOTE), edges(Severity.DOUBTFUL), edges(Severity.UNUSABLE)]
    motions = [SimpleNamespace(lost_frames=k) for k in (2, 3, 4)]
    opened = SimpleNamespace(
        projection=lambda: "0.1 0.2 0.7", ring_downs=lambda: motions[:2], creeps=lambda: motions[2:]
    )
    calls = called("eimi_lab.face.segmenting.find_edges", (sets, ["restated"]))
    called("eimi_lab.dataset.reading.open_dataset", nullcontext(opened))
    called("eimi_lab.dataset.moving.recording_checks.flagged_lines", lambda motions: [f"{len(motions)} flagged"])
    called("eimi_lab.vision.check.leaves_out", lambda flags: any(flag.severity is Severity.UNUSABLE for flag in flags))
    given: dict[str, Any] = {
        **{"specimen": "s", "calibration": Path("k"), "csv": Path("c"), "overlay": Path("v"), "explain": Path("e")},
        **{"dark": Path("d"), "flat": Path("f"), "uncorrected": "bare", "workers": 2, "force": "force"},
    }
    result = images.segment(dataset=Path("d.h5"), **vars(PictureOptions(axis=5.0)), **given)
    assert result.lines == [
        "restated",
        "weights of the colours from which the program computes grey values: 0.1 0.2 0.7",
        "d.h5: edges of 4 states, 2 with flags, 1 unusable",
        "d.h5: points of 2 ring-downs and of 1 states with creep",
        "3 flagged",
    ]
    assert result.content == {
        **{"dataset": Path("d.h5"), "states": 4, "flagged": 2, "unusable": 1, "ring_downs": 2, "creeps": 1},
        **{"flags": [[flag.name for flag in one.flags] for one in sets], "lost": [2, 3, 4], "restated": ["restated"]},
    }
    assert calls[0] == ("find_edges", (Path("d.h5"),), {**given, "changes": {"axis_angle_deg": 5.0}})
    opened.projection = opened.ring_downs = opened.creeps = lambda: ()
    opened.projection = lambda: None
    called("eimi_lab.face.segmenting.find_edges", (sets[:1], []))
    assert images.segment(dataset=Path("d.h5"), **vars(PictureOptions())).lines == [
        "d.h5: edges of 1 state, 0 with flags, 0 unusable"
    ]


def test_options_on_pictures_become_values_of_the_calibration() -> None:
    options = PictureOptions("1,2.5", 90.0, "1, 2,3,4", "dark", "red", "1,2.5,3", "1,2 3 , 4")
    assert options.changes() == {
        "clamp_midpoint_px": (1.0, 2.5),
        "axis_angle_deg": 90.0,
        "picture": {
            **{"region_px": (1, 2, 3, 4), "polarity": "dark", "channel": "red", "beam_colour": (1.0, 2.5, 3.0)},
            "along_px": ((1.0, 2.0), (3.0, 4.0)),
        },
    }
    assert PictureOptions().changes() == {}
    assert PictureOptions(axis=0.0).changes() == {"axis_angle_deg": 0.0}
    for text, count, whole, words in (
        ("1,2", 3, False, "should be 3 numbers, separated"),
        ("1,2.5", 2, True, "should be 2 whole numbers"),
        ("1,x", 2, False, "should be 2 numbers"),
    ):
        with pytest.raises(InputError, match=f"^--it {text}: {words}"):
            _numbers("--it", text, count, whole)
    assert len(_points("--along", "1,2 " * 2)) == 2
    assert len(_points("--along", "1,2 " * 6)) == 6
    for text in ("1,2", "1,2 " * 7, "1,2 3", "1,2 3,4,5", "1,2 a,b", ""):
        with pytest.raises(InputError, match="should be two to six points X,Y"):
            _points("--along", text)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"ring_down": True, "creep": True}, "give only one of them"),
        ({"rate": 5.0}, "--rate: is only for a motion"),
        ({"row_time": 0.0}, "--row-time: is only for a motion"),
        ({"creep": True, "rate": 0.0}, "--rate 0: should be greater than 0"),
        ({"creep": True, "exposure": -1.0}, "--exposure -1: should be greater than 0"),
        ({"creep": True, "exposure": float("inf")}, "--exposure inf: should be greater than 0"),
        ({"creep": True, "hanging": -0.1}, "--hanging -0.1: should be 0 or more"),
        ({"creep": True, "removed": -0.1}, "--removed -0.1: should be 0 or more"),
        ({"creep": True, "released": float("nan")}, "--released nan: should be 0 or more"),
    ],
)
def test_a_wrong_option_of_a_motion_is_named(given: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        MotionOptions(**given).motion_facts()


def test_options_of_a_motion_are_its_facts() -> None:
    assert MotionOptions().motion_facts() is None
    facts: Any = MotionOptions(
        ring_down=True, rate=60.0, released=-1.5, hanging=0.0, removed=0.2, exposure=0.01, row_time=-2e-5
    ).motion_facts()
    assert (facts.kind, facts.rate_Hz, facts.released_s, facts.hanging_N, facts.removed_N) == (
        *("ring_down", 60.0, -1.5, 0.0, 0.2),
    )
    assert (facts.exposure_s, facts.row_time_s) == (0.01, -2e-5)
    bare: Any = MotionOptions(creep=True).motion_facts()
    assert (bare.kind, bare.rate_Hz, bare.released_s, bare.hanging_N, bare.removed_N, bare.row_time_s) == (
        *("creep", None, None, 0.0, 0.0, 0.0),
    )


def test_options_of_tracked_points_place_them() -> None:
    placing = ImportOptions(
        unit="cm", pixels_per_mm=4.0, sigma=0.1, rest=3, plane="xz", clamp="1,2", axis=80.0
    ).placing(None)
    assert (placing.calibration, placing.unit, placing.pixels_per_mm, placing.sigma) == (None, "cm", 4.0, 0.1)
    assert (placing.rest, placing.plane, placing.clamp, placing.axis_deg) == (3, "xz", (1.0, 2.0), 80.0)
    calibration: Any = object()
    assert ImportOptions(unit="px").placing(calibration).calibration is calibration
    with pytest.raises(InputError, match="--clamp and --axis: the calibration gives these values already"):
        ImportOptions(axis=1.0).placing(calibration)
    with pytest.raises(InputError, match="are only for images"):
        ImportOptions(channel="red").placing(None)
    ImportOptions(format="dice").refuse_track_options()
    for name, value in {"unit": "mm", "pixels_per_mm": 0.0, "sigma": 0.0, "rest": 0, "plane": ""}.items():
        with pytest.raises(InputError, match=f"^--{name.replace('_', '-')}: is only for points of a tracking program"):
            ImportOptions(**{name: value}).refuse_track_options()  # type: ignore[arg-type]


@pytest.mark.parametrize(("as_json", "quiet"), [(False, False), (False, True), (True, False), (True, True)])
def test_a_result_is_printed_once(capsys: pytest.CaptureFixture[str], as_json: bool, quiet: bool) -> None:
    def command(*, path: Path, count: int = 3) -> Result:
        """Return the two parameters."""
        return Result(["a", path], {"count": count, "path": path, "µ": None})

    run = printing(command)
    run(path=Path("x"), count=4, as_json=as_json, quiet=quiet)
    printed = {
        (False, False): "a\nx\n",
        (False, True): "",
        (True, False): '{\n "count": 4,\n "path": "x",\n "µ": null\n}\n',
    }
    assert capsys.readouterr().out == printed.get((as_json, quiet), printed[True, False])
    assert (run.__name__, run.__doc__) == ("command", "Return the two parameters.")
    assert list(run.__annotations__) == ["path", "count", "as_json", "quiet"]
    printing(lambda: Result([], {}))(as_json=False, quiet=False)
    assert capsys.readouterr().out == ""
