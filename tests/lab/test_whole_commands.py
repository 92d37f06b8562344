"""The command line's statuses and the steps of the demonstration, with stand-ins for the commands and the bench."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import typer

from eimi_drivers.interfaces import InstrumentError, SwitchOffFailed, UnusableDriver
from eimi_lab import cli
from eimi_lab.config.protocol import load_protocol
from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import load_specimen
from eimi_lab.face import demonstrating
from eimi_lab.fits import simulated_fit
from eimi_lab.process.errors import InputError, OwnFault
from eimi_lab.process.stopping import Stopped

FAILURES: list[tuple[BaseException, int, str]] = [
    (InputError("a.toml: wrong"), 2, "a.toml: wrong"),
    (KeyboardInterrupt(), 130, "stopped by SIGINT"),
    (typer.Abort(), 130, "stopped by SIGINT"),
    (UnusableDriver("no such driver"), 2, "no such driver"),
    (InstrumentError("COM3: no answer"), 1, "COM3: no answer"),
    (OSError("disk full"), 1, "disk full"),
    (OwnFault("fit", "a fault"), 1, str(OwnFault("fit", "a fault"))),
]


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    lines: list[str] = []
    monkeypatch.setattr(cli, "tell", lines.append)
    return lines


def failing(monkeypatch: pytest.MonkeyPatch, error: BaseException) -> None:
    def run(*given: Any, **options: Any) -> Any:
        raise error

    monkeypatch.setattr(cli, "app", run)


@pytest.mark.parametrize(("error", "status", "words"), FAILURES)
def test_a_failure_has_its_status_and_one_line(
    error: BaseException, status: int, words: str, told: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    failing(monkeypatch, error)
    assert cli._status() == status
    assert told == [words]


def test_a_coil_that_cannot_be_switched_off_is_told_with_its_current(
    told: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    error = SwitchOffFailed("no answer", 1.5, 2.5)
    failing(monkeypatch, error)
    assert cli._status() == 1
    assert "1.500 A measured" in told[0]
    assert "no answer" in told[0]


def test_a_stopped_program_has_the_status_of_its_signal(told: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    stopped = Stopped(15)
    failing(monkeypatch, stopped)
    assert cli._status() == 128 + 15
    assert told == [stopped.in_words()]


def test_an_unknown_failure_is_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    failing(monkeypatch, ZeroDivisionError("never"))
    with pytest.raises(ZeroDivisionError):
        cli._status()


@pytest.mark.parametrize(("arguments", "passed"), [(["fit", "a.h5"], None), ([], ["--help"])])
def test_a_command_without_arguments_prints_its_help(
    arguments: list[str], passed: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[Any] = []
    monkeypatch.setattr(cli, "app", lambda *given, **options: calls.append((given, options)))
    monkeypatch.setattr(sys, "argv", ["eimi", *arguments])
    assert cli._status() == 0
    assert calls == [((passed,), {"standalone_mode": False})]
    monkeypatch.setattr(cli, "app", lambda *given, **options: 7)
    assert cli._status() == 7


def test_a_wrong_command_line_names_the_help_to_read(told: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    class Wrong(Exception):
        ctx: Any = None

        def format_message(self) -> str:
            return "No such option"

    for context, words in (
        (None, "eimi --help lists the commands, eimi COMMAND --help their options"),
        (SimpleNamespace(parent=None), "eimi --help lists the commands, eimi COMMAND --help their options"),
        (SimpleNamespace(parent=1, info_name="fit"), "eimi fit --help lists its arguments and options"),
    ):
        error = Wrong()
        error.ctx = context
        failing(monkeypatch, error)
        assert cli._status() == 2
        assert told.pop() == f"No such option ({words})"


def test_the_program_prepares_its_process_and_exits_with_its_status(monkeypatch: pytest.MonkeyPatch) -> None:
    order: list[Any] = []
    steps = ("unwind_on_termination", "one_thread_each", "open_closed_streams", "write_every_character")
    for name in steps:
        monkeypatch.setattr(cli, name, lambda name=name: order.append(name))

    @contextmanager
    def never_blocking() -> Iterator[None]:
        order.append("streams")
        yield

    monkeypatch.setattr(cli, "never_blocking", never_blocking)
    monkeypatch.setattr(cli, "_status", lambda: order.append("command") or 5)
    monkeypatch.delitem(sys.modules, "eimi_drivers.cameras.timed", raising=False)
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 5
    assert order == [*steps, "streams", "command"]
    timed: Any = SimpleNamespace(calls_under_way=lambda: False)
    monkeypatch.setitem(sys.modules, "eimi_drivers.cameras.timed", timed)
    left: list[int] = []
    monkeypatch.setattr(os, "_exit", left.append)
    with pytest.raises(SystemExit):
        cli.main()
    assert left == []
    timed.calls_under_way = lambda: True
    with pytest.raises(SystemExit):
        cli.main()
    assert left == [5]

    def stop() -> int:
        raise Stopped(2)

    monkeypatch.setattr(cli, "_status", stop)
    monkeypatch.setattr(cli, "tell", order.append)
    timed.calls_under_way = lambda: False
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 130
    assert order[-1] == Stopped(2).in_words()


class Bench:
    # Stand-ins for the steps of a demonstration, which note how they were called.

    def __init__(self, patch: pytest.MonkeyPatch, truth: Any) -> None:
        self.calls: list[Any] = []
        self.truth = truth
        fit = SimpleNamespace(initial_shear_modulus=SimpleNamespace(value=53e3))
        for name, result in (
            ("new_folder", None),
            ("forget_solids", None),
            ("load_evidence", "evidence"),
            ("grid", ["task"]),
            ("fit_grid", [fit]),
            ("write_report", None),
            ("executor_for", "executor"),
            ("acquire", None),
            ("on_terminal", "told"),
        ):
            patch.setattr(demonstrating, name, self.step(name, result))
        patch.setattr(demonstrating, "open_bench", self.context("open_bench", "bench"))
        patch.setattr(demonstrating, "open_dataset", self.context("open_dataset", self))
        of = SimpleNamespace(of=lambda fits: SimpleNamespace(write=self.step("write", None)))
        patch.setattr(demonstrating, "Fits", of)

    def step(self, name: str, result: Any) -> Callable[..., Any]:
        return lambda *given, **options: self.calls.append((name, given, options)) or result

    def context(self, name: str, result: Any) -> Callable[..., Any]:
        @contextmanager
        def entered(*given: Any, **options: Any) -> Iterator[Any]:
            self.calls.append((name, given, options))
            yield result() if callable(result) and name != "open_dataset" else result

        return entered

    @contextmanager
    def progress(self, title: str, steps: int) -> Iterator[Any]:
        self.calls.append(("progress", title, steps))
        yield f"{title} done"


@pytest.mark.parametrize("quick", [True, False])
def test_a_demonstration_makes_its_steps_in_order(quick: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    truth = {"model": "yeoh", "parameters": {"C10_Pa": 25e3, "C20_Pa": 1e3, "C30_Pa": 50.0}}
    bench: Any = Bench(monkeypatch, lambda: truth)
    found = demonstrating.demonstrate(
        tmp_path, " Dragon Skin 10", "type1", "virtual", quick=quick, seed=4, force=True, progress=bench.progress
    )
    protocol = load_protocol("dragon_skin_10_quick" if quick else "dragon_skin_10")
    models = ["neo-hookean"] if quick else list(demonstrating.LAWS)
    paths = [tmp_path / name for name in ("dataset.h5", "fits.json", "report.html")]
    assert [found.dataset, found.fits, found.report] == paths
    assert (found.true_model, found.true_parameters) == ("yeoh", truth["parameters"])
    (score,) = found.scores
    assert score.truth_Pa == 50e3
    assert score.difference_percent == pytest.approx(6.0)
    beam = load_specimen("type1")
    calls = bench.calls
    assert [call[0] if call[0] != "progress" else call[1] for call in calls] == [
        *("new_folder", "open_bench", "acquire", "on_terminal", "acquire", "forget_solids", "segment"),
        *("load_evidence", "grid", "fit", "executor_for", "fit_grid", "write", "write_report", "open_dataset"),
    ]
    named = {call[0]: call for call in calls if call[0] != "progress"}
    assert named["new_folder"][1] == (tmp_path, True)
    rig, opened, limits = named["open_bench"][1]
    assert (rig.name, opened.specimen.name, limits) == ("virtual", "type1", protocol.limits)
    assert named["open_bench"][2] == {"rate_Hz": protocol.rate_Hz}
    given = named["acquire"][1]
    assert (given[0], given[1].text, given[2], given[3:]) == (
        protocol,
        opened.text,
        rig,
        ("bench", paths[0], "told", True),
    )
    assert f'material = "{protocol.material}"' in opened.text
    assert opened.text.replace(protocol.material, "") == beam.text.replace(beam.specimen.material, "")
    assert named["on_terminal"][1] == ("acquire done",)
    assert named["load_evidence"][1:] == ((paths[0],), {"report": "segment done"})
    assert named["grid"][1] == (models, ["evidence"], [4])
    assert named["executor_for"][1] == (len(models), None)
    assert named["fit_grid"][1:] == ((["task"], {}), {"executor": "executor", "report": "fit done"})
    assert named["write"][1] == (paths[1], True)
    assert named["write_report"][1:] == (
        (paths[2], [paths[0]], [paths[1]]),
        {"force": True, "progress": bench.progress},
    )
    steps = {call[1]: call[2] for call in calls if call[0] == "progress"}
    assert steps == {"acquire": protocol.recordings, "segment": len(protocol.currents_A), "fit": len(models)}


def test_a_demonstration_needs_a_virtual_rig_and_its_true_law(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    bench: Any = Bench(monkeypatch, lambda: None)
    given: dict[str, Any] = {"quick": True, "seed": 1, "force": False, "progress": bench.progress}
    with pytest.raises(InputError, match=r"dataset\.h5: does not contain the true law of a virtual rig"):
        demonstrating.demonstrate(tmp_path, "dragon_skin_10", "type1", "virtual", **given)
    real: Any = SimpleNamespace(simulated=False)
    monkeypatch.setattr(demonstrating, "load_rig", lambda name: real)
    with pytest.raises(InputError, match="my_rig: is a real rig; the demonstration needs a virtual rig"):
        demonstrating.demonstrate(tmp_path, "dragon_skin_10", "type1", "my_rig", **given)
    assert load_rig("virtual").simulated


def test_a_simulation_tells_whether_the_fit_has_seen_the_dataset(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Any] = []

    class Fit:
        model = "yeoh"

        def __init__(self, *references: Any) -> None:
            self.datasets = references

        def values(self) -> list[float]:
            return [1.0, 2.0, 3.0]

    monkeypatch.setattr(simulated_fit, "FitRecord", Fit)
    compared: list[Any] = []
    assumed = SimpleNamespace(
        applied=lambda experiment: f"applied {experiment}",
        compared=lambda *given: compared.append(given) or "comparison",
        as_measured=lambda places: places + 0.5,
    )
    monkeypatch.setattr(simulated_fit, "assumptions_of", lambda fit, evidence, count: assumed)
    monkeypatch.setattr(simulated_fit, "polished", lambda experiment: f"polished {experiment}")
    monkeypatch.setattr(simulated_fit, "_validation", lambda *given: seen.append(given) or "validation")
    monkeypatch.setattr(simulated_fit, "points_on", lambda curves, count: np.full(2, float(count)))
    misfit = SimpleNamespace(
        weights=np.array([1.0, 0.0]),
        residuals=np.array([[0.1, 0.2]]),
        error_mm=np.array([[0.3]]),
        deviation_mm=np.array([[0.4]]),
    )
    asked: list[Any] = []

    def by_better_model(experiment: Any, plain: Any, against: Any, near: Any, options: Any) -> Any:
        asked.append((experiment, plain, near, options))
        assert against(["better"]) == "comparison"
        return better

    monkeypatch.setattr(simulated_fit, "by_better_model", by_better_model)
    specimen = SimpleNamespace(section="solid")
    experiment = SimpleNamespace(model=SimpleNamespace(specimen=specimen))
    evidence: Any = SimpleNamespace(experiment=experiment, sha256="12", path=Path("a.h5"))
    plain: Any = SimpleNamespace(error_mm=np.array([[0.2, 0.4]]), unconverged=np.array([False]))
    here = SimpleNamespace(sha256="12", section="solid")
    better: Any = (misfit, "curves", "correction")

    def simulated(*references: Any, method: Any = "interpolate") -> Any:
        fit: Any = Fit(*references)
        law: Any = SimpleNamespace(fit=fit, path=Path("fits.json"), index=2)
        return simulated_fit._simulated(evidence, law, ("near",), plain, method)  # type: ignore[arg-type]

    prediction, correction = simulated(here)
    assert correction == "correction"
    assert (prediction.edges_mm.tolist(), prediction.error_mm.tolist()) == ([6.5, 6.5], [0.3])
    assert prediction.deviation_mm.tolist() == [0.4]
    assert prediction.residuals_mm[0] == 0.1
    assert np.isnan(prediction.residuals_mm[1])
    assert seen[-1][2:] == (True, plain, misfit)
    simulated(SimpleNamespace(sha256="34", section="plane-stress"))
    assert seen[-1][2] is False
    (model, parameters, of), *_ = compared
    assert (model, parameters.tolist(), of) == ("yeoh", [[1.0, 2.0, 3.0]], "better")
    experiment_words, _, near, options = asked[0]
    assert experiment_words.startswith("polished applied")
    assert near == ("near",)
    assert (options.method, options.accuracy_mm) == ("interpolate", pytest.approx(max(simulated_fit.ACCURACY_MM, 3e-3)))
    with pytest.raises(InputError, match=r"fits\.json: fits\.2 assumed plane-stress for a\.h5, "):
        simulated(SimpleNamespace(sha256="12", section="plane-stress"))
    better = None
    assert simulated(here) == (None, None)
    prediction, correction = simulated(here, method="follow")
    assert (prediction.validation, correction) == ("validation", None)
    assert len(prediction.edges_mm) == len(prediction.error_mm) == 0
    plain.unconverged = np.array([True])
    assert simulated(here)[0].validation == "validation"
