# The functions of the Python interface pass their arguments on, and refuse those that contradict each other.

from __future__ import annotations

import inspect
from collections.abc import Callable
from contextlib import contextmanager, nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_fitting.inference.evidence.parameter_priors import Prior
from eimi_lab.config.calibration import Calibration
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.rig import Rig
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.dataset.reading import Dataset
from eimi_lab.face import acquiring, discovering, given, identifying, moving, results, segmenting, using
from eimi_lab.fits.fits_file import Fits
from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.tensile_record import TensileRecord
from eimi_lab.process.errors import InputError
from eimi_lab.process.stopping import Stopped

Called = Callable[..., list[Any]]
ACCEPTED = Path(__file__).parent / "accepted" / "python_functions.txt"


def bare(kind: type, **values: Any) -> Any:
    # Return an object of a class without calling its constructor.
    one = object.__new__(kind)
    for name, value in values.items():
        object.__setattr__(one, name, value)
    return one


def test_the_defaults_of_the_python_functions_are_as_accepted(tmp_path: Path) -> None:
    lines = []
    for module in (acquiring, discovering, identifying, moving, segmenting, using):
        for name, function in vars(module).items():
            if inspect.isfunction(function) and function.__module__ == module.__name__:
                defaults = {
                    key: getattr(one.default, "__name__", repr(one.default))
                    for key, one in inspect.signature(function).parameters.items()
                    if one.default is not one.empty
                }
                lines += [f"{name} {key} = {default}" for key, default in defaults.items()]
    (tmp_path / ACCEPTED.name).write_text("\n".join(lines) + "\n", encoding="utf-8")
    accepted = ACCEPTED.read_text(encoding="utf-8").splitlines() if ACCEPTED.exists() else []
    assert lines == accepted, f"the new description is {tmp_path / ACCEPTED.name}"


def test_arguments_are_paths_lists_or_objects() -> None:
    assert [given.several(one) for one in ("a", ["a", "b"], ("a",), (), 1.5)] == [["a"], ["a", "b"], ["a"], [], [1.5]]
    dataset = bare(Dataset, path=Path("d.h5"))
    assert given.path_of(dataset) == Path("d.h5")
    assert given.path_of("e.h5") == Path("e.h5")
    assert given.files("a", Path("b"), 3, None, "a", dataset) == [Path("a"), Path("b")]
    for kind, function in ((Protocol, given.protocol_of), (SpecimenFile, given.specimen_of), (Rig, given.rig_of)):
        one = kind.model_construct()
        assert function(one) is one  # type: ignore[operator]
        with pytest.raises(InputError):
            function("nonesuch.toml")  # type: ignore[operator]


def test_an_output_is_another_file_and_does_not_exist(tmp_path: Path) -> None:
    output = tmp_path / "o"
    assert given.output_of(None, [output], False) is None
    assert given.output_of(str(output), [tmp_path / "i"], False) == output
    with pytest.raises(InputError):
        given.output_of(output, [output], True)
    output.write_text("x")
    with pytest.raises(InputError, match="exists"):
        given.output_of(output, [], False)
    assert given.output_of(output, [], True) == output


@pytest.mark.parametrize("fails", [False, True])
def test_open_datasets_are_closed_meanwhile(fails: bool) -> None:
    states: list[str] = []
    dataset = bare(Dataset, path=Path("d.h5"))
    object.__setattr__(dataset, "close", lambda: states.append("closed"))
    object.__setattr__(dataset, "reopen", lambda: states.append("open"))
    try:
        with given.closed_meanwhile([dataset, "e.h5"]) as paths:
            assert paths == [Path("d.h5"), Path("e.h5")]
            assert states == ["closed"]
            if fails:
                raise KeyError
    except KeyError:
        assert fails
    assert states == ["closed", "open"]


def test_an_unknown_option_is_an_error() -> None:
    @given.named_options
    def act(a: int, *, window: int = 2) -> int:
        return a + window

    assert (act(1), act(1, window=5), act.__name__) == (3, 6, "act")
    with pytest.raises(TypeError, match=r"^act\(\) has no option 'windows'; .*window"):
        act(1, windows=3)  # type: ignore[call-arg]


def test_stated_values_become_those_of_a_calibration() -> None:
    none = (None,) * 7
    assert segmenting.stated_changes(*none) == {}
    assert segmenting.stated_changes((1.0, 2.0), 0.0, *none[2:]) == {
        "clamp_midpoint_px": (1.0, 2.0),
        "axis_angle_deg": 0.0,
    }
    whole = segmenting.stated_changes(
        None, None, (1, 2, 3, 4), "dark", "red", (5.0, 6.0, 7.0), [[1.0, 2.0], (3.0, 4.0)]
    )  # type: ignore[list-item]
    assert whole == {
        "picture": {
            **{"region_px": (1, 2, 3, 4), "polarity": "dark", "channel": "red", "beam_colour": (5.0, 6.0, 7.0)},
            "along_px": ((1.0, 2.0), (3.0, 4.0)),
        }
    }


def test_a_fit_passes_everything_on(called: Called) -> None:
    record = bare(FitRecord)
    fits: Any = [record, "other"]
    calls = called("eimi_lab.face.identifying.identify_laws", (fits, []))
    assert identifying.fit("d.h5", "yeoh") is record
    (_, (paths, models, options), keywords) = calls[-1]
    assert (paths, models) == ([Path("d.h5")], ["yeoh"])
    assert keywords == {
        **{"seeds": [1], "each": False, "bootstrap": 0, "workers": 1, "scheduler": None, "checkpoint": None},
        **{"resume": False, "output": None, "force": False},
    }
    values = {key: getattr(options, key) for key in ("section", "free", "prior", "tensile", "tensile_window")}
    assert values == {"section": None, "free": None, "prior": None, "tensile": None, "tensile_window": None}
    assert (options.include_flagged, options.tensile_weight, options.restarts, options.bipop, options.time) == (
        *(False, None, 0, False, "none"),
    )
    given_: dict[str, Any] = {
        **{"prior": [Prior("C10", 2e4, 500.0), "C20=1,2"], "section": "solid", "include_flagged": True},
        **{"free": ["width"], "tensile": "t.csv", "tensile_window": 30.0, "tensile_weight": 2.0, "restarts": 3},
        **{"bipop": True, "time": "prony", "seed": [4, 5], "each": "each", "bootstrap": 6, "workers": 7},
        **{"scheduler": "tcp://x", "checkpoint": "c", "resume": "resume", "output": "o", "force": "force"},
    }
    assert identifying.fit(["d.h5", "e.h5"], ["yeoh"], **given_) is fits
    (_, (paths, models, options), keywords) = calls[-1]
    assert (paths, models) == ([Path("d.h5"), Path("e.h5")], ["yeoh"])
    assert keywords == {
        **{"seeds": [4, 5], "each": "each", "bootstrap": 6, "workers": 7, "scheduler": "tcp://x"},
        **{"checkpoint": Path("c"), "resume": "resume", "output": Path("o"), "force": "force"},
    }
    assert options.prior == ["C10=20000.0,500.0", "C20=1,2"]
    assert (options.section, options.free, options.tensile, options.tensile_window) == (
        *("solid", ["width"], [Path("t.csv")], "30.0"),
    )
    assert (options.include_flagged, options.tensile_weight, options.restarts, options.bipop, options.time) == (
        *(True, 2.0, 3, True, "prony"),
    )
    for wrong in ({"each": True}, {"seed": [1, 2]}):
        with pytest.raises(InputError, match="give the law as a list, model = "):
            identifying.fit("d.h5", "yeoh", **wrong)  # type: ignore[call-overload]
    for name in ("datasets", "model", "seed"):
        with pytest.raises(InputError, match=f"^fit: {name} is an empty list; give at least one element"):
            identifying.fit(**{"datasets": "d.h5", "model": ["yeoh"], name: []})  # type: ignore[call-overload]
    with pytest.raises(InputError, match=r"^fit: seed = -1 should be 0 or more"):
        identifying.fit("d.h5", ["yeoh"], seed=[4, -1])


def test_fits_are_numbered_in_their_file_or_in_memory(called: Called) -> None:
    one, two = bare(FitRecord), bare(TensileRecord)
    both = bare(Fits, fits=(one, two))
    called("eimi_lab.face.identifying.read_fits_file", both)
    laws = identifying.fits_of([one, both, "f.json", two])
    memory = identifying.IN_MEMORY
    assert [(law.path, law.index) for law in laws] == [
        *((memory, 0), (memory, 1), (memory, 2), (Path("f.json"), 0), (Path("f.json"), 1), (memory, 5)),
    ]
    assert [law.fit for law in laws] == [one, one, two, one, two, two]


@pytest.mark.parametrize("checkpoint", [None, Path("c")])
def test_an_interrupted_fit_says_how_it_is_continued(checkpoint: Path | None) -> None:
    with pytest.raises(Stopped) as stopped, identifying._stopped_with(checkpoint):
        raise Stopped(15)
    assert stopped.value.number == 15
    words = "c contains all generations so far" if checkpoint else "nothing of the fit is stored"
    assert words in str(vars(stopped.value)) + str(stopped.value)


@contextmanager
def reporting(title: str, total: int) -> Any:
    report: Any = SimpleNamespace(title=title, total=total, lines=[])

    class Report:
        underway = "underway"

        def __call__(self, line: str) -> None:
            report.lines.append(line)

    told = Report()
    told.title, told.total, told.lines = title, total, report.lines  # type: ignore[attr-defined]
    REPORTS.append(told)
    yield told


REPORTS: list[Any] = []


@pytest.mark.parametrize("case", ["states", "motions and states", "motions alone"])
def test_laws_are_fitted_to_states_and_motions(
    called: Called, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, case: str
) -> None:
    REPORTS.clear()
    monkeypatch.setattr(identifying, "progress", reporting)
    written: list[Any] = []
    content = SimpleNamespace(write=lambda path, force: written.append((path, force)))
    monkeypatch.setattr(identifying.Fits, "of", staticmethod(lambda fits: written.append(fits) or content))
    motions = [
        SimpleNamespace(path=Path("a"), has_states=case != "motions alone"),
        SimpleNamespace(path=Path("b"), has_states=False),
    ]
    calls = called("eimi_lab.fits.recorded_motions.load_motions", lambda path, section: f"motions of {path}")
    called("eimi_lab.fits.recorded_motions.with_ring_downs", motions)
    called("eimi_lab.fits.time_fits.fit_motions", lambda law, motions, seed: (law, seed))
    called("eimi_lab.fits.time_fits.with_law_of_time", lambda record, evidence, motions: (record.name, record.seed))
    called("eimi_lab.process.workers.executor_for", "executor")
    called("eimi_lab.fits.fit_grid.grid", ["task", "task 2"])
    called("eimi_lab.fits.checkpoint.Checkpoint.of", "log")
    evidence = SimpleNamespace(path=Path("a"), sha256="hash")
    called("eimi_lab.fits.fit_grid.fit_grid", [SimpleNamespace(name="f", seed=9, datasets=[evidence])])
    options: Any = SimpleNamespace(
        **{"section": None, "tensile": None, "has_law_of_time": case != "states", "head": dict},
        **{"for_identify": lambda: "identify", "check_laws": lambda laws: None, "check": lambda evidence: None},
        load=lambda path: evidence,
        check_motions=lambda datasets, others: None,
    )
    paths, output = [Path("a"), Path("b")], tmp_path / "fits.json"
    fits, found = identifying.identify_laws(
        paths, ["yeoh", "ogden"], options, seeds=[4, 5], workers=3, scheduler="tcp://x", output=output, force=True
    )
    assert fits is content
    assert written[-1] == (output, True)
    by_name = {name: (arguments, keywords) for name, arguments, keywords in calls}
    assert by_name["executor_for"][0] == (3, "tcp://x")
    assert "of" not in by_name
    if case == "motions alone":
        assert found == []
        assert written[0] == [("yeoh", 4), ("yeoh", 5), ("ogden", 4), ("ogden", 5)]
        return
    assert found == [evidence] * (1 if case == "motions and states" else 2)
    assert by_name["grid"] == ((["yeoh", "ogden"], found, [4, 5]), {"each": False, "bootstrap": 0})
    arguments, keywords = by_name["fit_grid"]
    assert arguments == (["task", "task 2"], "identify")
    assert keywords | {"report": REPORTS[0]} == {
        **{"executor": "executor", "checkpoint": None, "share_checkpoint": False, "report": REPORTS[0]},
        "underway": "underway",
    }
    assert (REPORTS[0].title, REPORTS[0].total) == ("fit", 2)
    if case == "motions and states":
        assert written[0] == [("f", 9)]
        assert [name for name, *_ in calls].count("with_ring_downs") == 2
    identifying.identify_laws(paths, ["yeoh"], options, checkpoint=tmp_path / "c", resume=True, force=True)
    _, (checkpoint, head), how = next(call for call in calls if call[0] == "of")
    assert (checkpoint, how) == (tmp_path / "c", {"resume": True, "force": True})
    assert (head.fits, head.datasets) == (("task", "task 2"), ("hash",) * len(found))
    assert next(how for name, _, how in calls[::-1] if name == "fit_grid")["share_checkpoint"] is True
    output.write_text("x")
    with pytest.raises(InputError, match="exists"):
        identifying.identify_laws(paths, ["yeoh"], options, output=output)


def test_a_tensile_test_is_fitted_in_each_window(
    called: Called, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    calls = called("eimi_lab.fits.tensile_files.read_tensile", "test")
    called("eimi_lab.fits.tensile_fits.fit_window", lambda *given: given)
    fits: list[Any] = []
    written: list[Any] = []
    content = SimpleNamespace(write=lambda path, force: written.append((path, force)))
    monkeypatch.setattr(identifying.Fits, "of", staticmethod(lambda rows: fits.append(rows) or content))
    identifying.tensile(
        "c.csv", ["yeoh", "ogden"], window=[20, "full"], relative=True, output=tmp_path / "o", force=True
    )
    assert fits[-1] == [
        *(("test", "yeoh", 20.0, True), ("test", "ogden", 20.0, True)),
        *(("test", "yeoh", None, True), ("test", "ogden", None, True)),
    ]
    assert written == [(tmp_path / "o", True)]
    identifying.tensile("c.csv", "yeoh")
    assert fits[-1] == [("test", "yeoh", percent, False) for percent in (20.0, 50.0, 100.0, None)]
    assert calls[0] == ("read_tensile", (Path("c.csv"),), {})


def test_simulate_takes_the_parameters_from_one_place(called: Called) -> None:
    written: list[Any] = []
    result = SimpleNamespace(write=lambda path, force: written.append((path, force)))
    calls = called("eimi_lab.face.using.simulated", result)
    called("eimi_lab.face.using.specimen_of", "beam")
    assert using.simulate([0.0, 0.5], "s", "neo-hookean", parameter={"mu": 4e4}) is result
    _, (beam, law, values, field_mT, gravity, field, bulk, drawn), _ = calls[-1]
    assert (beam, law.name, np.asarray(values).tolist()) == ("beam", "neo-hookean", [4e4])
    assert field_mT.tolist() == [0.0, 2.35]
    assert (gravity, field, bulk, drawn) == (0.0, 90.0, None, None)
    using.simulate(
        [1.0],
        "s",
        "yeoh",
        parameter=["C10_Pa=1", "C20_Pa=2", "C30_Pa=3"],
        coil_constant=2.0,
        gravity_angle=3.0,
        field_angle=4.0,
        bulk_modulus_kPa=5.0,
        output="o",
        force=True,
    )
    _, (_, law, values, field_mT, gravity, field, bulk, drawn), _ = calls[-1]
    assert (law.name, np.asarray(values).tolist(), field_mT.tolist()) == ("yeoh", [1.0, 2.0, 3.0], [2.0])
    assert (gravity, field, bulk, drawn) == (3.0, 4.0, 5.0, None)
    assert written == [("o", True)]
    with pytest.raises(InputError, match="model is missing"):
        using.simulate([1.0], "s")
    with pytest.raises(InputError, match=r"^simulate: index = 7 is the number of a fit; leave it out, or give fit"):
        using.simulate([1.0], "s", "neo-hookean", parameter={"mu": 1.0}, index=7)
    with pytest.raises(InputError, match="fit and parameter both give the parameters"):
        using.simulate([1.0], "s", fit="f.json", parameter={"mu": 1.0})
    with pytest.raises(InputError, match=r"neo-hookean has no parameter 'nu'; .*mu"):
        using.simulate([1.0], "s", "neo-hookean", parameter={"nu": 1.0})
    assert using._parameter_texts("neo-hookean", {"mu_Pa": 3.0}) == ["mu_Pa=3.0"]


@pytest.mark.parametrize(
    ("records", "model", "index", "asked"),
    [
        (["yeoh"], None, None, ("yeoh", None)),
        (["yeoh", "yeoh"], None, None, ("yeoh", None)),
        (["yeoh", "ogden"], None, 1, ("ogden", 1)),
        (["yeoh", "ogden"], "ogden", None, ("ogden", None)),
        (["yeoh"], "yeoh", None, ("yeoh", None)),
        (["yeoh", "yeoh"], None, 1, ("yeoh", 1)),
    ],
)
def test_simulate_chooses_a_fit(
    called: Called, records: list[str], model: str | None, index: int | None, asked: tuple[str, int | None]
) -> None:
    fits = [SimpleNamespace(path=Path("f"), fit=SimpleNamespace(model=name)) for name in records]
    chosen = SimpleNamespace(model="neo-hookean", values=lambda: [4e4], drawn=lambda most: f"{most} draws")
    calls = called("eimi_lab.face.using.fits_of", fits)
    called("eimi_lab.face.using.choose_fit", chosen)
    called("eimi_lab.face.using.specimen_of", "beam")
    called("eimi_lab.face.using.protocol_of", SimpleNamespace(currents_A=(1.0, 2.0)))
    called("eimi_lab.face.using.simulated", "result")
    assert using.simulate("p", "s", model, fit="f.json", index=index) == "result"
    by_name = {name: arguments for name, arguments, _ in calls}
    assert by_name["choose_fit"] == (Path("f"), [one.fit for one in fits], *asked)
    assert by_name["simulated"][1].name == "neo-hookean"
    assert by_name["simulated"][3].tolist() == [4.7, 9.4]
    assert by_name["simulated"][7] == "60 draws"


def test_each_dataset_is_predicted_with_each_fit(
    called: Called, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    REPORTS.clear()
    monkeypatch.setattr(using, "progress", reporting)
    calls = called("eimi_lab.face.using.fits_of", ["f", "g"])
    called("eimi_lab.face.using.load_evidence", lambda path, **how: SimpleNamespace(path=path, how=how))
    called("eimi_lab.face.using.predict", lambda pairs: [(law, measured.path) for law, measured in pairs])
    written: list[Any] = []
    monkeypatch.setattr(results.Validations, "write", lambda self, path, force: written.append((path, force)))
    output = tmp_path / "v.json"
    judged = using.validate(["a", "b"], "x.json", section="solid", include_flagged=True, output=output, force=True)
    assert judged.predictions == (("f", Path("a")), ("g", Path("a")), ("f", Path("b")), ("g", Path("b")))
    assert [how for name, _, how in calls if name == "load_evidence"] == [{"section": "solid", "flagged": True}] * 2
    assert (REPORTS[0].title, REPORTS[0].total, REPORTS[0].lines) == ("validate", 2, ["a, 2 fits", "b, 2 fits"])
    assert written == [(output, True)]
    using.validate("a", "x.json")
    assert len(written) == 1
    with pytest.raises(InputError):
        using.validate("a", tmp_path / "x.json", output=tmp_path / "x.json", force=True)


def test_a_run_is_planned(called: Called, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    base = SimpleNamespace(currents_A=(0.0, 0.1, 0.2))
    called("eimi_lab.face.using.protocol_of", base)
    called("eimi_lab.face.using.rig_of", "rig")
    called("eimi_lab.face.using.specimen_of", lambda name: f"beam {name}")
    fits = [SimpleNamespace(path=Path("f"), fit="one"), SimpleNamespace(path=Path("f"), fit="two")]
    called("eimi_lab.face.using.fits_of", fits)
    calls = called("eimi_lab.fits.planning.Goal.of", "goal")
    called("eimi_lab.fits.planning.mountings", "mountings")
    called("eimi_lab.fits.planning.plan", ["run"])
    written: list[Any] = []
    monkeypatch.setattr(results.Plan, "write", lambda self, path, force: written.append((path, force)))
    planned = using.plan("f.json", "p", ["s", "t"], "r")
    assert (planned.goal, planned.runs, planned.base) == ("goal", ("run",), base)
    tail = {name: arguments for name, arguments, _ in calls}
    assert tail["of"] == (Path("f"), ["one", "two"], None, "modulus")
    assert tail["mountings"] == (["beam s", "beam t"], "rig", [], [], False)
    assert tail["plan"] == ("goal", "mountings", "rig", base, 3)
    assert written == []
    using.plan(
        "f.json",
        "p",
        "s",
        "r",
        states=4,
        goal="mu",
        model="yeoh",
        gravity_angle=90.0,
        tip_weight=[1.0, 2.0],
        both_polarities=True,
        output=tmp_path / "o",
        force=True,
    )
    tail = {name: arguments for name, arguments, _ in calls}
    assert tail["of"] == (Path("f"), ["one", "two"], "yeoh", "mu")
    assert tail["mountings"] == (["beam s"], "rig", [90.0], [1.0, 2.0], True)
    assert tail["plan"][4] == 4
    assert written == [(tmp_path / "o", True)]
    with pytest.raises(InputError):
        using.plan("f.json", "p", str(tmp_path / "s"), "r", output=tmp_path / "s", force=True)


@pytest.mark.parametrize("in_memory", [False, True])
def test_a_report_reads_stored_fits_and_those_in_memory(
    called: Called, monkeypatch: pytest.MonkeyPatch, in_memory: bool, tmp_path: Path
) -> None:
    record = bare(FitRecord)
    stored: list[Path] = []

    def write(self: Any, path: Path) -> Path:
        stored.append(path)
        return path

    monkeypatch.setattr(
        using.Fits, "of", staticmethod(lambda fits: SimpleNamespace(write=lambda path: write(None, path)))
    )
    calls = called("eimi_lab.process.workers.executor_for", "executor")
    called("eimi_lab.reporting.page.write_report")
    done = using.report(["a", "b"], "o.html", fit=["f.json", record] if in_memory else "f.json", workers=5)
    assert (done.path, done.assets) == (Path("o.html"), None)
    assert calls[0] == ("executor_for", (2, None), {})
    _, (output, paths, fits), keywords = calls[1]
    assert (output, paths) == (Path("o.html"), [Path("a"), Path("b")])
    assert fits == [Path("f.json"), *stored]
    assert len(stored) == in_memory
    assert (keywords["force"], keywords["assets"], keywords["executor"]) == (False, None, "executor")
    done = using.report("a", "o.html", assets="figures", force=True)
    assert done.assets == Path("figures")
    assert (calls[-1][2]["force"], calls[-1][2]["assets"], calls[-1][2]["executor"]) == (True, Path("figures"), None)
    with pytest.raises(InputError):
        using.report(tmp_path / "a", tmp_path / "a", force=True)


def test_results_are_published_and_exported(called: Called, tmp_path: Path) -> None:
    calls = called("eimi_lab.face.using.archive_of", "archive")
    called("eimi_lab.face.using.load_people", "authors")
    assert using.publish("r", "o.eln") == "archive"
    nobody = {"title": None, "people": None, "licence": None, "force": False}
    assert calls == [("archive_of", ([Path("r")], Path("o.eln")), nobody)]
    using.publish(["r", "s"], "o.eln", title="t", people="p", licence="l", force=True)
    keywords = {"title": "t", "people": "authors", "licence": "l", "force": True}
    assert calls[-1] == ("archive_of", ([Path("r"), Path("s")], Path("o.eln")), keywords)
    fits = [
        SimpleNamespace(path=Path("f"), fit=SimpleNamespace(model="yeoh")),
        SimpleNamespace(path=Path("g"), fit=SimpleNamespace(model="ogden")),
    ]
    called("eimi_lab.face.using.fits_of", fits)
    called("eimi_lab.face.using.choose_fit", "chosen")
    called("eimi_lab.face.using.bulk_modulus_Pa", 7.0)
    called("eimi_lab.face.using.card", "*CARD")
    with pytest.raises(InputError, match=r"^f: holds several laws; give --model with one of yeoh, ogden"):
        using.export("f.json", to="abaqus")
    with pytest.raises(InputError, match=r"^f: holds several laws; give --model with one of yeoh, ogden"):
        using.simulate([1.0], "s", fit="f.json")
    assert using.export("f.json", "yeoh", to="abaqus") == "*CARD"
    tail = {name: arguments for name, arguments, _ in calls}
    assert tail["choose_fit"] == (Path("f"), [one.fit for one in fits], "yeoh", None)
    assert tail["bulk_modulus_Pa"] == ("chosen", "abaqus", None, None)
    assert tail["card"] == (Path("f"), "chosen", "abaqus", 7.0)
    using.export(
        "f.json", "ogden", to="sofa", index=1, bulk_modulus_kPa=3.0, bulk_ratio=4.0, output=tmp_path / "o", force=True
    )
    tail = {name: arguments for name, arguments, _ in calls}
    assert tail["choose_fit"][2:] == ("ogden", 1)
    assert tail["bulk_modulus_Pa"] == ("chosen", "sofa", 3.0, 4.0)
    assert (tmp_path / "o").read_text() == "*CARD"
    with pytest.raises(InputError, match="exists"):
        using.export("f.json", "yeoh", to="abaqus", output=tmp_path / "o")


def test_pictures_and_points_are_imported(called: Called, tmp_path: Path) -> None:
    calls = called("eimi_lab.face.segmenting.open_dataset", lambda path: f"open {path}")
    called("eimi_lab.face.segmenting.specimen_of", "beam")
    called("eimi_lab.face.segmenting.load_calibration", "loaded")
    called("eimi_lab.face.segmenting.changed_calibration", "changed")
    called("eimi_lab.dataset.dark_and_flat.read_correction_images", "correction")
    called("eimi_lab.dataset.importing.import_frames")
    assert segmenting.import_pictures("p", "s.csv", "b", "c", "o.h5") == "open o.h5"
    tail = {name: arguments for name, arguments, _ in calls}
    assert tail["load_calibration"] == ("c", {})
    assert tail["read_correction_images"] == (None, None)
    frames = tail["import_frames"]
    assert frames[:7] == (Path("p"), Path("s.csv"), "beam", "loaded", Path("o.h5"), False, False)
    assert frames[8:] == ("correction", None)
    calibration = Calibration.model_construct()
    segmenting.import_pictures(
        "p", "s.csv", "b", calibration, "o.h5", average="mean", every=3, dark="d", flat="f", axis=5.0, force="force"
    )
    tail = {name: arguments for name, arguments, _ in calls}
    assert tail["changed_calibration"] == (calibration, {"axis_angle_deg": 5.0})
    assert tail["read_correction_images"] == (Path("d"), Path("f"))
    assert tail["import_frames"][3:7] == ("changed", Path("o.h5"), "force", "mean")
    assert tail["import_frames"][9] == 3
    for name in ("p", "s.csv", "b", "c", "d", "f"):
        paths = {key: str(tmp_path / key) for key in ("p", "s.csv", "b", "c", "d", "f")}
        with pytest.raises(InputError):
            segmenting.import_pictures(
                *(paths[key] for key in ("p", "s.csv", "b", "c")), paths[name], dark=paths["d"], flat=paths["f"]
            )
    called("eimi_lab.dataset.tracked.points_csv.import_points")
    assert segmenting.import_points("p", "s.csv", "b", "o.h5", gravity_angle=30.0, force=True) == "open o.h5"
    assert calls[-2] == (
        "import_points",
        (Path("p"), Path("s.csv"), "beam", 30.0, Path("o.h5"), True),
        {"gravity": True},
    )
    segmenting.import_points("p", "s.csv", "b", "o.h5", no_gravity=True)
    assert calls[-2][1:] == ((Path("p"), Path("s.csv"), "beam", None, Path("o.h5"), False), {"gravity": False})
    with pytest.raises(InputError, match="tracked points need gravity_angle"):
        segmenting.import_points("p", "s.csv", "b", "o.h5")
    with pytest.raises(InputError):
        segmenting.import_points(tmp_path / "p", "s.csv", "b", tmp_path / "p", no_gravity=True)


def test_segment_passes_everything_on(called: Called, monkeypatch: pytest.MonkeyPatch) -> None:
    files: list[Any] = []
    calls = called("eimi_lab.face.segmenting.open_dataset", lambda path: f"open {path}")

    def find(path: Path, **how: Any) -> None:
        calls.append(("find_edges", path, how))
        files.append([how[name] and Path(how[name]).read_text() for name in ("specimen", "calibration")])

    monkeypatch.setattr(segmenting, "find_edges", find)
    monkeypatch.setattr(segmenting, "to_toml", lambda document: "from toml")
    assert segmenting.segment("d.h5") == "open d.h5"
    assert calls[0][1:] == (
        Path("d.h5"),
        {
            **{"specimen": None, "calibration": None, "changes": {}, "csv": None, "overlay": None, "explain": None},
            **{"dark": None, "flat": None, "uncorrected": False, "workers": 1, "force": False},
        },
    )
    beam, calibration = SpecimenFile.model_construct(), Calibration.model_construct()
    monkeypatch.setattr(SpecimenFile, "text", "given text", raising=False)
    monkeypatch.setattr(Calibration, "text", "", raising=False)
    segmenting.segment(
        "d.h5",
        specimen=beam,
        calibration=calibration,
        axis=3.0,
        csv="c",
        overlay="o",
        explain="e",
        dark="d",
        flat="f",
        uncorrected=True,
        workers=4,
        force=True,
    )
    assert files[-1] == ["given text", "from toml"]
    how = calls[-2][2]
    assert {key: how[key] for key in ("csv", "overlay", "explain", "dark", "flat")} == {
        **{"csv": Path("c"), "overlay": Path("o"), "explain": Path("e"), "dark": Path("d"), "flat": Path("f")},
    }
    assert (how["changes"], how["uncorrected"], how["workers"], how["force"]) == (
        {"axis_angle_deg": 3.0},
        True,
        4,
        True,
    )
    assert segmenting._as_file("type1", Path("x")) == "type1"


@pytest.mark.parametrize("found", [True, False])
def test_edges_are_found_and_stored(
    called: Called, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, found: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    REPORTS.clear()
    opened = SimpleNamespace(
        states=[SimpleNamespace(index=k) for k in range(3)],
        creep_frames=lambda index: None if index == 1 else "frames",
        recorded_ring_downs=lambda: ["r"] * 4,
    )
    edges = [SimpleNamespace(left=SimpleNamespace(sigma_mm=[0.1] * (found or k == 0))) for k in range(3)]
    calls = called("eimi_lab.face.segmenting.open_dataset", nullcontext(opened))
    package = "eimi_lab.dataset.segmentation"
    for name in ("write_csv", "write_overlays", "write_explained"):
        called(f"{package}.{name}")
    called(f"{package}.segment", edges)
    called(f"{package}.explain_missing_beam", ("It is dark.", b"picture"))
    called("eimi_lab.dataset.dark_and_flat.read_correction_images", lambda dark, flat: dark and "correction")
    called("eimi_lab.dataset.dark_and_flat.store_correction")
    called("eimi_lab.dataset.dark_and_flat.forget_correction")
    called("eimi_lab.dataset.restating.restate", lambda *given, **how: ("a line",) if how["specimen"] else ())
    called("eimi_lab.process.outputs.whole_folder", lambda folder, force: nullcontext(f"unfinished {folder}"))
    called("eimi_lab.process.workers.executor_for", "executor")
    monkeypatch.setattr("eimi_lab.process.progress.progress", reporting)
    dataset = tmp_path / "d.h5"
    assert segmenting.find_edges(dataset) == (edges, ())
    names = [name for name, *_ in calls]
    assert names[:4] == ["open_dataset", "read_correction_images", "executor_for", "segment"]
    assert (REPORTS[0].title, REPORTS[0].total) == ("segment", 9)
    told = capsys.readouterr().err
    picture = tmp_path / "d_where.png"
    if found:
        assert told == ""
        assert not picture.exists()
    else:
        assert f"state 1: no beam was found; It is dark. {picture} shows where the program searched" in told
        assert picture.read_bytes() == b"picture"
        assert calls[-1][1] == (dataset, 1)
    calls.clear()
    _, changed = segmenting.find_edges(
        dataset,
        specimen="s",
        calibration="c",
        csv=Path("c"),
        overlay=Path("o"),
        explain=Path("e"),
        dark=Path("dark"),
        workers=3,
        force=True,
    )
    assert changed == ("a line",)
    tail = {name: (arguments, how) for name, arguments, how in calls}
    assert tail["restate"] == ((dataset,), {"specimen": "s", "calibration": Path("c"), "changes": {}})
    assert tail["store_correction"][0] == (dataset, "correction")
    assert tail["executor_for"][0] == (3, None)
    assert tail["write_csv"][0] == ("unfinished c", edges)
    assert tail["write_overlays"][0] == ("unfinished o", dataset, edges)
    assert tail["write_explained"][0] == ("unfinished e", dataset)
    assert [arguments for name, arguments, _ in calls if name == "whole_folder"] == [
        *((Path("c"), True), (Path("o"), True), (Path("e"), True)),
    ]
    capsys.readouterr()
    segmenting.find_edges(dataset, changes={"axis_angle_deg": 1.0}, uncorrected=True)
    assert "nothing changed, because the dataset has these values already" in capsys.readouterr().err
    assert "forget_correction" in [name for name, *_ in calls]
    with pytest.raises(InputError, match="--uncorrected: removes the dark frame"):
        segmenting.find_edges(dataset, dark=Path("dark"), uncorrected=True)


def read(source: Path, **how: Any) -> Any:
    values: dict[str, Any] = {
        **{"calibration": None, "changes": {}, "tool": None, "placing": lambda loaded: ("placing", loaded)},
        **{"has_gravity_direction": False, "output": source.with_name("o.h5")},
    }
    facts = SimpleNamespace(row_time_s=how.pop("row_time_s", 0.0), exposure_s=how.pop("exposure_s", None))
    return moving.read_motions(source, "beam", facts, **{**values, **how})  # type: ignore[arg-type]


def test_a_motion_is_read_from_a_video_or_from_points(called: Called, tmp_path: Path) -> None:
    video, table, image, folder = (tmp_path / name for name in ("v.mp4", "t.csv", "i.png", "folder"))
    for file in (video, table, image):
        file.write_bytes(b"")
    folder.mkdir()
    gravity = {"has_gravity_direction": True}
    for source, how, words in (
        (tmp_path / "none", {}, "no such file"),
        (folder, {}, "is a folder; a motion is read"),
        (image, {}, "is one image; a motion is read"),
        (video, gravity, "--gravity-angle and --no-gravity: are only for tracked points"),
        (video, {"tool": "dice"}, "--format: is for the file of a tracking program"),
        (table, {}, "tracked points need --gravity-angle"),
        (table, {**gravity, "row_time_s": 1e-5}, "--row-time and --exposure: are only for a video"),
        (table, {**gravity, "exposure_s": 0.1}, "--row-time and --exposure: are only for a video"),
        (table, {**gravity, "changes": {"axis_angle_deg": 1.0}}, "is in the beam frame already"),
    ):
        with pytest.raises(InputError, match=words):
            read(source, **how)  # type: ignore[arg-type]
    calls = called("eimi_lab.face.moving.load_calibration", "loaded")
    called("eimi_lab.dataset.moving.tracked_motion.read_tracked_motion", ("tracked",))
    called("eimi_lab.dataset.moving.motion_csv.read_motion_csv", ("from table",))
    assert read(table, **gravity).motions == ("from table",)
    assert calls[-1][1][:2] == (table, "beam")
    with pytest.raises(InputError, match="is in the beam frame already"):
        read(table, calibration="c")
    done = read(table, tool="dice", calibration="c")
    assert (done.motions, done.calibration) == (("tracked",), "loaded")
    assert calls[-1][1][:4] == (table, "dice", "beam", ("placing", "loaded"))
    assert read(folder, tool="dice", **gravity).calibration is None
    called("eimi_lab.face.moving._of_video", "from video")
    assert read(video, calibration="c", changes={"a": 1}) == "from video"
    assert calls[-1][1][3:] == ("c", {"a": 1}, tmp_path / "o.h5")


def test_a_video_needs_a_calibration_or_points(called: Called, tmp_path: Path) -> None:
    source, output = tmp_path / "v.mp4", tmp_path / "o.h5"
    calls = called(
        "eimi_lab.dataset.moving.filmed_motion.read_video_motions", SimpleNamespace(motions=("m",), calibration="c")
    )
    called("eimi_lab.dataset.moving.clicked_line.clicked_from_changes", "clicked")
    called("eimi_lab.face.moving.load_calibration", "loaded")
    called("eimi_lab.dataset.moving.filmed_motion.frame_at_rest", np.zeros((40, 60), np.uint8))
    facts: Any = "facts"
    with pytest.raises(
        InputError, match=r"a video needs --calibration, or --along .*o_where\.png shows the beam at rest"
    ):
        moving._of_video(source, "beam", facts, None, {}, output)  # type: ignore[arg-type]
    assert (tmp_path / "o_where.png").stat().st_size > 0
    along = {"picture": {"along_px": ((1.0, 2.0), (3.0, 4.0))}}
    done = moving._of_video(source, "beam", facts, None, along, output)  # type: ignore[arg-type]
    assert (done.motions, done.calibration) == (("m",), "c")
    assert calls[-2] == ("clicked_from_changes", (along, "beam", str(source)), {})
    assert calls[-1] == ("read_video_motions", (source, "clicked", "beam", "facts"), {"is_clicked": True})
    for key in ("axis_angle_deg", "clamp_midpoint_px"):
        moving._of_video(source, "beam", facts, None, {**along, key: 1.0}, output)  # type: ignore[arg-type]
        assert calls[-1][2] == {"is_clicked": False}
    moving._of_video(source, "beam", facts, "c.toml", along, output)  # type: ignore[arg-type]
    assert calls[-2] == ("load_calibration", ("c.toml", along), {})
    assert calls[-1] == ("read_video_motions", (source, "loaded", "beam", "facts"), {"is_clicked": False})


def test_a_motion_is_imported(called: Called, tmp_path: Path) -> None:
    made: list[Any] = []

    def read_motions(*given: Any, **how: Any) -> Any:
        made.append((given, how))
        return SimpleNamespace(motions=("m",), calibration="c")

    calls = called("eimi_lab.face.moving.read_motions", read_motions)
    called("eimi_lab.face.moving.specimen_of", "beam")
    called("eimi_lab.face.moving.open_dataset", lambda path: f"open {path}")
    called("eimi_lab.dataset.moving.motion_import.write_motion_dataset")
    output = tmp_path / "o.h5"
    assert moving.import_motion("v.mp4", "s", output) == f"open {output}"
    (source, beam, facts), how = made[-1]
    assert (source, beam, how["calibration"], how["changes"], how["tool"]) == (Path("v.mp4"), "beam", None, {}, None)
    assert (how["has_gravity_direction"], how["output"]) == (False, output)
    assert (facts.kind, facts.rate_Hz, facts.released_s, facts.hanging_N, facts.removed_N) == (
        *("ring_down", None, None, 0.0, 0.0),
    )
    assert (facts.exposure_s, facts.row_time_s) == (None, 0.0)
    written = [arguments for name, arguments, _ in calls if name == "write_motion_dataset"]
    assert written == [(output, ("m",), "beam", "c", None, True, False)]
    moving.import_motion(
        "t",
        "s",
        output,
        kind="creep",
        calibration="cal",
        clamp=(1.0, 2.0),
        axis=3.0,
        gravity_angle=4.0,
        rate=5.0,
        released=6.0,
        hanging=7.0,
        removed=8.0,
        exposure=9.0,
        row_time=10.0,
        format="dice",
        unit="cm",
        pixels_per_mm=11.0,
        sigma=12.0,
        rest=13,
        plane="xz",
        force=True,
    )
    (_, _, facts), how = made[-1]
    assert (facts.kind, facts.rate_Hz, facts.released_s, facts.hanging_N, facts.removed_N) == (
        *("creep", 5.0, 6.0, 7.0, 8.0),
    )
    assert (facts.exposure_s, facts.row_time_s, how["tool"], how["has_gravity_direction"]) == (9.0, 10.0, "dice", True)
    placing = how["placing"]("loaded")
    assert (placing.calibration, placing.unit, placing.pixels_per_mm, placing.clamp) == (
        "loaded",
        "cm",
        11.0,
        (1.0, 2.0),
    )
    assert (placing.axis_deg, placing.sigma, placing.rest, placing.plane) == (3.0, 12.0, 13, "xz")
    written = [arguments for name, arguments, _ in calls if name == "write_motion_dataset"]
    assert written[-1] == (output, ("m",), "beam", "c", 4.0, True, True)
    moving.import_motion("t", "s", output, no_gravity=True)
    assert made[-1][1]["has_gravity_direction"] is True
    written = [arguments for name, arguments, _ in calls if name == "write_motion_dataset"]
    assert written[-1][4:6] == (None, False)
    for wrong in ({"rate": 0.0}, {"rate": -1.0}, {"exposure": 0.0}, {"rate": float("inf")}):
        with pytest.raises(InputError, match="should be a finite number greater than 0"):
            moving.import_motion("t", "s", output, **wrong)  # type: ignore[arg-type]
    for name in ("hanging", "removed"):
        with pytest.raises(InputError, match=f"^t: {name} = -1 should be a finite number, 0 or more"):
            moving.import_motion("t", "s", output, **{name: -1.0})  # type: ignore[arg-type]
    output.write_text("x")
    with pytest.raises(InputError, match="exists"):
        moving.import_motion("t", "s", output)
    with pytest.raises(InputError):
        moving.import_motion(output, "s", output, force=True)


@pytest.mark.parametrize(
    ("count", "lost", "words"),
    [(1, 0, "5 frames of ring-down"), (3, 2, "15 frames of ring-down after 3 flicks, 6 lost")],
)
def test_motions_in_words(count: int, lost: int, words: str) -> None:
    motions: Any = tuple(SimpleNamespace(kind="ring_down", time_s=range(5), lost_frames=lost) for _ in range(count))
    assert moving.ReadMotions(motions, None).in_words == words


def test_a_run_is_acquired(called: Called) -> None:
    for name, answer in (("protocol_of", "protocol"), ("specimen_of", "beam"), ("rig_of", "rig")):
        called(f"eimi_lab.face.acquiring.{name}", answer)
    calls = called("eimi_lab.face.acquiring.run_protocol", Path("stored"))
    called("eimi_lab.face.acquiring.open_dataset", lambda path: f"open {path}")
    called("eimi_lab.face.acquiring.dry_steps", (["short"], ["whole", "list"]))
    assert acquiring.acquire("p", "s", "r", "o.h5") == "open stored"
    listener = acquiring.ignore_event
    _, arguments, how = calls[-2]
    assert arguments == ("protocol", "beam", "rig", Path("o.h5"))
    assert how == {
        **{"read": [Path("p"), Path("s"), Path("r")], "resume": False, "take_over": False, "note": ""},
        **{"transcript": None, "on_event": listener, "force": False},
    }
    given_: dict[str, Any] = {"resume": "resume", "take_over": "take", "note": "n", "on_event": print, "force": "force"}
    acquiring.acquire("p", "s", "r", "o.h5", transcript="t", **given_)
    assert {key: calls[-2][2][key] for key in given_} == given_
    assert calls[-2][2]["transcript"] == Path("t")
    steps = acquiring.acquire("p", "s", "r", dry_run=True)
    assert (steps.lines, repr(steps)) == (("whole", "list"), "whole\nlist")
    with pytest.raises(InputError, match="acquire: output is missing"):
        acquiring.acquire("p", "s", "r")  # type: ignore[call-overload]
    dataset = bare(Dataset)
    assert acquiring.open(dataset) is dataset
    assert acquiring.open("d.h5") == "open d.h5"


def test_a_dry_run_has_a_summary_and_all_steps(called: Called, capsys: pytest.CaptureFixture[str]) -> None:
    def dry(protocol: Any, specimen: Any, rig: Any, say: Any, whole: Any) -> None:
        say("first")
        whole("message")
        say("… and 3 more")
        say("last")

    calls = called("eimi_lab.acquisition.dry_run.dry_run", dry)
    called(
        "eimi_lab.acquisition.playback.describe_recording_length", lambda protocol, rig: rig == "long" and "It is long."
    )
    called("eimi_lab.acquisition.run.check_request")
    assert acquiring.dry_steps("p", "s", "r") == (["first", "… and 3 more", "last"], ["first", "message", "last"])  # type: ignore[arg-type]
    assert calls[0] == ("check_request", ("p", "s", "r"), {})
    assert calls[1] == ("describe_recording_length", ("p", "r"), {})
    assert calls[2][1][:3] == ("p", "s", "r")
    assert capsys.readouterr().err == ""
    acquiring.dry_steps("p", "s", "long")  # type: ignore[arg-type]
    assert "It is long." in capsys.readouterr().err


@pytest.fixture
def protocol_run(called: Called, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    monkeypatch.setattr("eimi_lab.process.progress.progress", reporting)
    calls = called("eimi_lab.acquisition.run.check_request")
    called("eimi_lab.acquisition.playback.describe_recording_length", lambda protocol, rig: rig.length)
    called("eimi_lab.acquisition.resuming.refuse_taken")
    called("eimi_lab.dataset.file_system.network_file_system", lambda folder: "nfs" if folder.name == "net" else "")
    called("eimi_lab.process.writer_lock.only_writer", nullcontext())
    called("eimi_lab.acquisition.event_words.on_terminal", lambda report: report.lines.append)
    called("eimi_lab.acquisition.event_lines.sending_events", lambda both, descriptor: nullcontext(both))
    called("eimi_lab.acquisition.open_bench.open_bench", nullcontext("bench"))
    watched = SimpleNamespace(bench="watched bench", show="show", typed="typed")
    called("eimi_lab.page.watched_run.watched", nullcontext(watched))
    called("eimi_lab.page.watched_run.Descriptors.of", SimpleNamespace(events=7))
    called("eimi_lab.acquisition.run.acquire", Path("stored"))
    monkeypatch.setattr(acquiring.sys, "stdin", SimpleNamespace(isatty=lambda: False))
    REPORTS.clear()
    return calls


def run_protocol(output: Path, **how: Any) -> Path:
    protocol: Any = SimpleNamespace(recordings=3, limits="limits", rate_Hz=12.0)
    rig: Any = SimpleNamespace(simulated=how.pop("simulated", False), length=how.pop("length", ""))
    return acquiring.run_protocol(protocol, "beam", rig, output, **how)  # type: ignore[arg-type]


def test_a_protocol_runs_with_its_listeners(
    protocol_run: list[Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    heard: list[Any] = []
    output = tmp_path / "o.h5"
    done = run_protocol(
        output, read=[Path("p")], take_over=True, transcript=tmp_path / "t", on_event=heard.append, events=True
    )
    assert done == Path("stored")
    assert capsys.readouterr().err == ""
    tail = {name: (arguments, how) for name, arguments, how in protocol_run}
    assert tail["refuse_taken"] == ((output, False), {})
    assert tail["only_writer"][0] == (output,)
    assert tail["sending_events"][0][1] == 1
    send = tail["sending_events"][0][0]
    send("an event")
    assert (heard, REPORTS[0].lines) == (["an event"], ["an event"])
    assert (REPORTS[0].title, REPORTS[0].total) == ("acquire", 3)
    arguments, how = tail["open_bench"]
    assert arguments[1:] == ("beam", "limits", tmp_path / "t")
    assert how == {"on_event": send, "guardian_events": 1, "rate_Hz": 12.0}
    assert tail["watched"][0][:2] == (None, "bench")
    assert tail["watched"][0][3] is send
    arguments, how = tail["acquire"]
    assert arguments[1] == "beam"
    assert arguments[3:] == ("watched bench", output, send, False)
    assert how == {"resume": False, "take_over": True, "note": "", "show": "show", "typed": "typed"}
    run_protocol(output, watched_by="3,4,5", force=True, note="n")
    tail = {name: (arguments, how) for name, arguments, how in protocol_run}
    assert tail["sending_events"][0][1] == 7
    assert tail["open_bench"][1]["guardian_events"] == 7
    assert tail["watched"][0][0].events == 7
    assert (tail["acquire"][0][6], tail["acquire"][1]["note"]) == (True, "n")
    protocol_run.clear()
    run_protocol(output, resume=True)
    tail = {name: (arguments, how) for name, arguments, how in protocol_run}
    assert "refuse_taken" not in tail
    assert tail["sending_events"][0][1] is None
    assert tail["acquire"][1]["resume"] is True


def test_a_run_that_cannot_be_is_refused_and_a_risk_is_told(
    protocol_run: list[Any], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    output, transcript = tmp_path / "o.h5", tmp_path / "t"
    for how, words in (
        ({"resume": True, "force": True}, "--resume: continues the run in an existing dataset"),
        ({"resume": True, "note": "n"}, "--resume: continues the run in an existing dataset"),
        ({"note": "caf\udce9"}, r"--note 'caf\\udce9': character 4 is not text in UTF-8"),
        ({"transcript": transcript, "simulated": True}, "--transcript: a virtual supply exchanges no messages"),
        ({"transcript": output}, "o.h5"),
        ({"read": [output]}, "o.h5"),
    ):
        with pytest.raises(InputError, match=words):
            run_protocol(output, **how)  # type: ignore[arg-type]
    transcript.write_text("x")
    with pytest.raises(InputError, match="exists"):
        run_protocol(output, transcript=transcript, force=True)
    assert "acquire" not in [name for name, *_ in protocol_run]
    capsys.readouterr()
    (tmp_path / "net").mkdir()
    monkeypatch.setattr(acquiring.sys, "stdin", SimpleNamespace(isatty=lambda: True))
    run_protocol(tmp_path / "net" / "o.h5", length="It is long.")
    told = capsys.readouterr().err
    assert "It is long." in told
    assert "o.h5 is on a network drive (nfs)" in told
    assert "press p and Enter to pause the run" in told
    monkeypatch.setattr(acquiring.sys, "stdin", None)
    run_protocol(output)
    assert capsys.readouterr().err == ""


def test_terms_are_discovered(called: Called, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    package = "eimi_lab.fits.discovering"
    calls = called(f"{package}.library_of", "library")
    called(f"{package}.discovered", "discovery")
    called(f"{package}.content", {"c": 1})
    called("eimi_lab.fits.tensile_files.read_curve", lambda path, percent, weight: (path, percent, weight))
    called("eimi_lab.face.discovering.load_evidence", lambda path, **how: (path, how))
    written: list[Any] = []
    monkeypatch.setattr(results.Discovered, "write", lambda self, path, force: written.append((path, force)))
    done = discovering.discover("a")
    assert (done.discovery, done.content, written) == ("discovery", {"c": 1}, [])
    tail = {name: (arguments, how) for name, arguments, how in calls}
    assert tail["library_of"][0] == ([],)
    numbers = {"most_terms": 3, "lot": 0.02, "seed": 1}
    evidence = ((Path("a"), {"section": None, "flagged": False}),)
    assert tail["discovered"] == ((evidence, ()), {"library": "library", **numbers})
    assert tail["content"] == (("discovery", evidence, ()), numbers)
    discovering.discover(
        ["a", "b"],
        tensile="t.csv",
        tensile_window=40,
        term="i1",
        most_terms=2,
        lot=0.1,
        section="solid",
        include_flagged=True,
        seed=5,
        output=tmp_path / "o",
        force=True,
    )
    tail = {name: (arguments, how) for name, arguments, how in calls}
    assert tail["library_of"][0] == (["i1"],)
    assert tail["discovered"][0][1] == ((Path("t.csv"), 40.0, 1.0),)
    assert tail["discovered"][0][0][1] == (Path("b"), {"section": "solid", "flagged": True})
    assert tail["discovered"][1] == {"library": "library", "most_terms": 2, "lot": 0.1, "seed": 5}
    assert written == [(tmp_path / "o", True)]
    with pytest.raises(InputError):
        discovering.discover("a", tensile=tmp_path / "t", output=tmp_path / "t", force=True)


def test_results_are_printed_and_written(called: Called, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    goal = SimpleNamespace(value=lambda size: f"{size:.1f} %", in_words=lambda: "the modulus")
    runs = tuple(
        SimpleNamespace(
            mounting=SimpleNamespace(in_words=lambda: "hanging"), expected=e, spaced=e + 1.0, currents_A=(0.0, 0.25)
        )
        for e in (1.0, 2.0)
    )
    plan = results.Plan(goal, runs, "base")  # type: ignore[arg-type]
    calls = called("eimi_lab.fits.planning.protocol_text", "text = 1\n")
    called("eimi_lab.fits.planning.table", ["one", "two"])
    called("eimi_lab.face.results.parse", "parsed")
    assert (plan.text, plan.protocol, repr(plan)) == ("text = 1\n", "parsed", "one\ntwo")
    assert calls[0] == ("protocol_text", (goal, runs[0], "base"), {})
    assert calls[2] == ("parse", (Protocol, "text = 1\n", "plan"), {})
    assert calls[3] == ("table", (goal, runs), {})
    assert plan.write(tmp_path / "p") == tmp_path / "p"
    assert (tmp_path / "p").read_text() == "text = 1\n"
    with pytest.raises(InputError, match="exists"):
        plan.write(tmp_path / "p")
    plan.write(tmp_path / "p", True)
    html = plan._repr_html_()
    assert "<td>hanging</td><td>1.0 %</td><td>2.0 %</td><td>0, 0.25</td>" in html
    assert "<th>planned</th><th>equally spaced</th>" in html
    discovery: Any = SimpleNamespace(
        **{"statement": "Two agree.", "identified": False},
        alternatives=[
            SimpleNamespace(terms=[SimpleNamespace(name="I1"), SimpleNamespace(name="I2")], held_out_error=1.239)
        ],
    )
    found = results.Discovered(discovery, {"a": 1})
    assert (found.statement, found.identified) == ("Two agree.", False)
    assert "<td>I1 + I2</td><td>1.24</td>" in found._repr_html_()
    called("eimi_lab.face.results.lines", ["x", "y"])
    assert repr(found) == "x\ny"
    assert calls[-1][1] == (discovery, Path("discovery.json"))
    assert found.write(tmp_path / "d") == tmp_path / "d"
    assert (tmp_path / "d").read_text() == '{\n "a": 1\n}\n'
    with pytest.raises(InputError, match="exists"):
        found.write(tmp_path / "d")
    report = results.Report(Path("a/o.html"))
    assert (report.assets, report.__fspath__()) == (None, str(Path("a/o.html")))
    assert report._repr_html_() == '<a href="a/o.html" target="_blank">o.html</a>'


def test_comparisons_are_counted_and_drawn(called: Called) -> None:
    def state(field: float, error: float) -> Any:
        return SimpleNamespace(field_mT=field, error_mm=error)

    evidence = [object(), object()]
    predictions: Any = tuple(
        SimpleNamespace(
            evidence=evidence[k // 2],
            residuals_mm=k,
            validation=SimpleNamespace(
                **{"model": f"law{k}", "dataset": f"x/{k // 2}.h5", "by_state": [state(0.5, k)]},
                fit=SimpleNamespace(path="fits.json", index=k),
                _repr_html_=lambda k=k: f"<{k}>",
            ),
        )
        for k in range(4)
    )
    judged = results.Validations(predictions)
    assert (len(judged), judged[2], list(judged)) == (4, predictions[2].validation, [p.validation for p in predictions])
    assert judged.evidence == tuple(evidence)
    calls = called("eimi_lab.face.results.Residuals.of", "residuals")
    called("eimi_lab.fits.fit_figures.drawn_errors_of_several", "figure")
    called("eimi_lab.face.results.by_dataset", ["a", "b"])
    assert judged.residuals() == "residuals"
    assert calls[-1][1] == (evidence[0], 0)
    judged.residuals(3)
    assert calls[-1][1] == (evidence[1], 3)
    assert judged.plot() == "figure"
    assert calls[-1][1] == ({f"law{k} on {k // 2}.h5": ([0.5], [k]) for k in range(4)},)
    assert repr(judged) == "a\nb"
    assert judged._repr_html_() == "<0><1><2><3>"
