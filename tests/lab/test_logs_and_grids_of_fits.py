"""Stored searches, predictions, material cards, and fits for many combinations of inputs have the expected contents."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_fitting import LAWS
from eimi_fitting.inference.doubts.checks import NotExplained
from eimi_fitting.inference.evidence.quantity import Quantity
from eimi_fitting.inference.searching.modulus_range import NothingActs
from eimi_fitting.inference.searching.search import Generation, Objectives, OtherSearch
from eimi_fitting.laws.cards import NotInSolver
from eimi_lab.fits import checkpoint, export, fit_grid, prediction
from eimi_lab.fits.bootstrap_record import ReplicateRecord
from eimi_lab.fits.checkpoint import Checkpoint, GenerationLog, Head
from eimi_lab.fits.fit_grid import Task
from eimi_lab.fits.options import FitOptions
from eimi_lab.fits.simulated_fit import Prediction
from eimi_lab.fits.tensile_record import TensileRecord
from eimi_lab.fits.time_records import RingDownRecord
from eimi_lab.process.errors import InputError

HEAD = Head(fits=("yeoh", "ogden"), datasets=("ab", "cd"), options=asdict(FitOptions()), versions={"numpy": "2.0"})
ONE = Generation(run=1, best_mm=0.5, mean_mm=0.75, step_size=0.25, axis_ratio=1.5, discarded=2)
TRIED = Objectives((0.5, 1.0), 3, 4)


def generation(number: int) -> Generation:
    return replace(ONE, best_mm=0.5 / number)


def replicate(number: int, modulus_Pa: float = 50e3) -> ReplicateRecord:
    return ReplicateRecord(
        replicate=number,
        parameters={"mu_Pa": modulus_Pa},
        initial_shear_modulus_Pa=modulus_Pa,
        mean_error_mm=0.01234,
        evaluations=7,
        stop="enough",
        wall_s=1.0,
    )


def test_a_checkpoint_logs_generations_and_finished_fits(tmp_path: Path) -> None:
    path = tmp_path / "log"
    log = Checkpoint(path, HEAD, resume=False)
    assert json.loads(path.read_text()) == json.loads(HEAD.model_dump_json())
    for fit, number in ((0, 1), (1, 1), (1, 2)):
        running = log.log_of(fit)
        assert (running.fit, running.path, len(running.logged), running.generation) == (fit, path, number - 1, 0)
        running.generation = number - 1
        running(generation(number), TRIED)
    log.finish(0, replicate(3))
    lines = path.read_text().split("\n")
    assert json.loads(lines[1]) == {
        "fit": 0,
        "generation": 1,
        "objective_mm": [0.5, 1.0],
        "unconverged": 3,
        "unstable": 4,
        "search": {"run": 1, "best_mm": 0.5, "mean_mm": 0.75, "step_size": 0.25, "axis_ratio": 1.5, "discarded": 2},
    }
    assert json.loads(lines[4])["fit"] == 0
    assert [line.search.best_mm for line in log.log_of(1).logged] == [0.5, 0.25]
    assert log.finished() == {0: replicate(3)}
    assert log.log_of(1).replay == (TRIED, TRIED)


def test_repeated_generations_are_compared_and_new_ones_appended(tmp_path: Path) -> None:
    path = tmp_path / "log"
    log = Checkpoint(path, HEAD, resume=False)
    for number in (1, 2):
        running = log.log_of(1)
        running.generation = number - 1
        running(generation(number), TRIED)
    before = path.read_text()
    again = log.log_of(1)
    again(generation(1), TRIED)
    again(generation(2), TRIED)
    assert path.read_text() == before
    again(generation(3), TRIED)
    assert path.read_text().count("\n") == before.count("\n") + 1
    other = log.log_of(1)
    other(generation(1), TRIED)
    with pytest.raises(OtherSearch, match="generation 2 of the search differs by more than rounding errors from the "):
        other(generation(1), TRIED)


def test_generations_after_a_missing_line_are_computed_again(tmp_path: Path) -> None:
    path = tmp_path / "log"
    log = Checkpoint(path, HEAD, resume=False)
    for number in (1, 3, 4, 1):
        GenerationLog(path, 0, (), number - 1)(generation(2 * number), TRIED)
    assert [line.search.best_mm for line in log.log_of(0).logged] == [0.25]
    GenerationLog(path, 0, (), 1)(generation(9), TRIED)
    assert [line.generation for line in log.log_of(0).logged] == [1, 2, 3, 4]
    assert log.log_of(0).logged[0].search == generation(2)  # the first of two lines with one number counts


def test_an_incomplete_last_line_does_not_damage_the_next_one(tmp_path: Path) -> None:
    path = tmp_path / "log"
    log = Checkpoint(path, HEAD, resume=False)
    GenerationLog(path, 0, ())(generation(1), TRIED)
    with path.open("a") as file:
        file.write('\n{"fit": 0, "gener')
    GenerationLog(path, 0, (), 1)(generation(2), TRIED)
    assert [line.generation for line in log.log_of(0).logged] == [1, 2]


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('{"fit": 2, "finished": REPLICATE}', "complete line 2: fit = 2 should be from 0 to 1"),
        ('{"fit": -1, "finished": REPLICATE}', "complete line 2: fit = -1 should be from 0 to 1"),
        ('{"fit": 0}', "complete line 2: generation: Field required"),
        ("3", "complete line 2: Input should be"),
        ('{"fit": 0, "finished": 3}', "complete line 2: finished"),
        ('{"fit": 0, "generation": 1, "objective_mm": [NaN], "unconverged": 0}', None),
    ],
)
def test_a_wrong_line_of_a_checkpoint_is_named(line: str, words: str | None, tmp_path: Path) -> None:
    path = tmp_path / "log"
    log = Checkpoint(path, HEAD, resume=False)
    with path.open("a") as file:
        file.write("\n" + line.replace("REPLICATE", replicate(1).model_dump_json()))
    if words is None:
        assert log.finished() == {}  # a number that is no JSON
        return
    with pytest.raises(InputError) as refused:
        log.finished()
    assert str(refused.value).startswith(f"{path}: {words}")


def test_objectives_of_a_checkpoint_are_finite() -> None:
    line = {"fit": 0, "generation": 1, "unconverged": 0, "unstable": 0, "search": ONE}
    checkpoint.GenerationLine.model_validate({**line, "objective_mm": [1.0]})
    for value in (np.inf, np.nan):
        with pytest.raises(ValueError, match="finite"):
            checkpoint.GenerationLine.model_validate({**line, "objective_mm": [value]})


def test_a_checkpoint_is_continued_replaced_or_refused(tmp_path: Path) -> None:
    path = tmp_path / "log"
    Checkpoint(path, HEAD, resume=False).finish(1, replicate(2))
    with pytest.raises(InputError, match="log: exists already; give --resume to continue it, --force to replace it"):
        Checkpoint(path, HEAD, resume=False)
    assert Checkpoint(path, HEAD, resume=True).finished() == {1: replicate(2)}
    with pytest.raises(InputError, match="to resume, fits should be the same: yeoh, ogden in the checkpoint, yeoh her"):
        Checkpoint(path, HEAD.model_copy(update={"fits": ("yeoh",)}), resume=True)
    assert Checkpoint(path, HEAD, resume=False, force=True).finished() == {}
    path.write_text("")
    assert Checkpoint(path, HEAD, resume=True).finished() == {}  # an empty file is begun
    path.write_text("{}")
    with pytest.raises(InputError, match="is not a checkpoint of `eimi fit`: the first line of the file is wrong"):
        Checkpoint(path, HEAD, resume=True)
    path.write_text("\n\n")
    with pytest.raises(InputError, match="the first line of the file is wrong"):
        Checkpoint(path, HEAD, resume=True)
    with pytest.raises(InputError, match="--resume: give the checkpoint of the interrupted fit, --checkpoint FILE"):
        Checkpoint.of(None, HEAD, resume=True, force=False)
    assert Checkpoint.of(tmp_path / "new", HEAD, resume=True, force=False).finished() == {}
    with pytest.raises(InputError, match="exists already"):
        Checkpoint.of(tmp_path / "new", HEAD, resume=False, force=False)
    assert Checkpoint.of(tmp_path / "new", HEAD, resume=False, force=True).path == tmp_path / "new"


def test_a_checkpoint_that_cannot_be_read_or_written_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="absent/log: "):
        Checkpoint(tmp_path / "absent" / "log", HEAD, resume=False)
    log = Checkpoint(tmp_path / "log", HEAD, resume=False)
    (tmp_path / "log").unlink()
    with pytest.raises(InputError, match=r"log: cannot be read as a checkpoint \(No such file or directory\)"):
        log.finished()


@dataclass(frozen=True)
class Data:
    # A stand-in for a dataset: its path, its number of states, and its experiment in words.

    path: Path
    states: tuple[Any, ...]
    experiment: Any = "measured"


A, B = Data(Path("a.h5"), (1, 2, 3)), Data(Path("b.h5"), (1, 2), "bent")


@pytest.fixture
def unchecked(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    seen: list[Any] = []
    monkeypatch.setattr(fit_grid, "check_evidence", seen.extend)
    return seen


def test_a_grid_has_a_task_for_each_combination(unchecked: list[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    both: Any = [A, B]
    tasks = fit_grid.grid(["yeoh", "ogden", "yeoh"], both, [5, 6, 5], bootstrap=1)
    assert [(t.model, len(t.evidence), t.seed, t.replicate) for t in tasks] == [
        (model, 2, seed, number) for model in ("yeoh", "ogden") for seed in (5, 6) for number in (0, 1)
    ]
    assert unchecked == [A, B]
    assert [str(t) for t in tasks[:2]] == ["yeoh a.h5 b.h5 seed 5", "yeoh a.h5 b.h5 seed 5 replicate 1"]
    alone = fit_grid.grid(["yeoh"], both, [1], each=True)
    assert [(t.evidence, t.replicate) for t in alone] == [((A,), 0), ((B,), 0)]
    with pytest.raises(InputError, match=r"^a\.h5: 3 states are too few; --bootstrap needs at least 5 states"):
        fit_grid.grid(["yeoh"], both, [1], each=True, bootstrap=1)
    monkeypatch.setattr(fit_grid, "FEWEST_STATES", 6)
    with pytest.raises(InputError, match=r"^a\.h5, b\.h5: 5 states are too few"):
        fit_grid.grid(["yeoh"], both, [1], bootstrap=1)


@dataclass(frozen=True)
class Record:
    # A stand-in for the record of a fit.

    of: str
    mean_error_mm: float = 0.01234
    bootstrap: Any = None


class Log:
    # A stand-in for a checkpoint, in which the fit with index 1 is finished.

    path = Path("log")

    def __init__(self, folder: Path, done: dict[int, Any]) -> None:
        self.folder, self.done = folder, done

    def finished(self) -> dict[int, Any]:
        return dict(self.done)

    def log_of(self, index: int) -> Any:
        return GenerationLog(self.folder / f"{index}", index, ())

    def finish(self, index: int, record: Any) -> None:
        self.done[index] = record


@pytest.fixture
def identified(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    # The arguments of the searches, which return their arguments at once.
    calls: list[dict[str, Any]] = []

    def identify(**arguments: Any) -> Any:
        calls.append(arguments)
        arguments["progress"](generation(2), TRIED)
        return f"{arguments['model']} {arguments['experiments']}"

    monkeypatch.setattr(fit_grid, "identify", identify)
    monkeypatch.setattr(fit_grid, "resampled", lambda experiments, seed, number: [*experiments, seed, number])
    monkeypatch.setattr(fit_grid.FitRecord, "of", lambda fit, evidence: Record(fit))
    monkeypatch.setattr(fit_grid.ReplicateRecord, "of", lambda fit, number: replicate(number))
    return calls


def test_the_fits_of_a_grid_are_computed_in_order_and_told(identified: list[dict[str, Any]]) -> None:
    evidence: Any = (A, B)
    tasks = [Task("yeoh", evidence, 5), Task("yeoh", evidence, 5, 1), Task("ogden", evidence, 5)]
    told: list[str] = []
    underway: list[str] = []
    fits: Any = fit_grid.fit_grid(tasks, {"restarts": 2, "seed": 9}, report=told.append, underway=underway.append)
    assert [{k: v for k, v in call.items() if k != "progress"} for call in identified] == [
        {"restarts": 2, "model": "yeoh", "experiments": ["measured", "bent"], "seed": 5},
        {"restarts": 2, "model": "yeoh", "experiments": ["measured", "bent", 5, 1], "seed": 5},
        {"restarts": 2, "model": "ogden", "experiments": ["measured", "bent"], "seed": 5},
    ]
    assert [fit.of for fit in fits] == ["yeoh ['measured', 'bent']", "ogden ['measured', 'bent']"]
    assert fits[0].bootstrap.replicates == (replicate(1),)
    assert fits[1].bootstrap is None
    assert told == [f"{task}, mean error 12.34 µm" for task in tasks]
    assert underway == [f"{task}, generation 1, smallest objective so far 250.00 µm" for task in tasks]


def test_a_grid_continues_from_its_checkpoint(identified: list[dict[str, Any]], tmp_path: Path) -> None:
    evidence: Any = (A,)
    tasks = [Task(model, evidence, 5) for model in ("yeoh", "ogden")]
    log: Any = Log(tmp_path, {1: Record("stored")})
    told: list[str] = []
    fits: Any = fit_grid.fit_grid(tasks, {}, checkpoint=log, report=told.append)
    assert [fit.of for fit in fits] == ["yeoh ['measured']", "stored"]
    assert told == ["ogden a.h5 seed 5: from the checkpoint", "yeoh a.h5 seed 5, mean error 12.34 µm"]
    assert log.done[0].of == "yeoh ['measured']"
    assert identified[0]["replay"] == ()
    assert (tmp_path / "0").exists()  # the generation was logged
    log.done.pop(0)
    fit_grid.fit_grid(tasks, {}, checkpoint=log, share_checkpoint=False)
    assert "replay" not in identified[1]


def test_a_search_that_cannot_be_continued_or_is_refused_names_its_file(
    monkeypatch: pytest.MonkeyPatch, identified: list[dict[str, Any]], tmp_path: Path
) -> None:
    evidence: Any = (A, B)
    log: Any = Log(tmp_path, {})

    def identify(**arguments: Any) -> Any:
        raise OtherSearch("generation 2 differs")

    monkeypatch.setattr(fit_grid, "identify", identify)
    with pytest.raises(InputError, match=r"^log: the fit cannot be continued from this file: generation 2 differs"):
        fit_grid.fit_grid([Task("yeoh", evidence, 1)], {}, checkpoint=log)

    def refuse(**arguments: Any) -> Any:
        raise NothingActs("nothing bends the beam")

    monkeypatch.setattr(fit_grid, "identify", refuse)
    with pytest.raises(InputError, match=r"^a\.h5, b\.h5: nothing bends the beam"):
        fit_grid.fit_grid([Task("yeoh", evidence, 1)], {})
    state: Any = Data(Path("b.h5"), (SimpleNamespace(index=4), SimpleNamespace(index=7)))
    error = NotExplained.__new__(NotExplained)
    Exception.__init__(error, "not explained")
    error.experiment, error.state = 1, 1
    assert str(fit_grid.refused(error, [evidence[0], state])) == "b.h5: state 7: not explained"


@dataclass(frozen=True)
class Predicted:
    # A stand-in for a prediction, which counts how often an interval was computed.

    name: str
    intervals: int = 0

    def in_words(self) -> str:
        return self.name


def beam_data(name: str, section: str, states: int = 3, width_mm: float = 3.0) -> Any:
    specimen = SimpleNamespace(section=section, width_mm=width_mm, length_mm=30.0)
    model = SimpleNamespace(specimen=specimen)
    return SimpleNamespace(path=Path(name), states=range(states), experiment=SimpleNamespace(model=model))


@contextmanager
def no_pool() -> Iterator[Any]:
    class Pool:
        def submit(self, function: Any, *arguments: Any, **named: Any) -> Any:
            from concurrent.futures import Future

            future: Future[Any] = Future()
            future.set_result(function(*arguments, **named))
            return future

        def shutdown(self, *arguments: Any, **named: Any) -> None:
            pass

    yield Pool()


@pytest.mark.parametrize("is_pool", [False, True])
def test_predictions_come_first_without_and_then_with_their_intervals(
    monkeypatch: pytest.MonkeyPatch, is_pool: bool
) -> None:
    def each(evidence: Any, laws: Any) -> Iterator[Any]:
        for law in laws:
            yield None if law == "alone" else Predicted(f"{evidence.path} {law}")

    monkeypatch.setattr(prediction, "simulate_each", each)
    monkeypatch.setattr(prediction, "simulate_alone", lambda evidence, law: Predicted(f"{evidence.path} {law} alone"))
    monkeypatch.setattr(prediction, "_with_interval", lambda one: replace(one, intervals=one.intervals + 1))
    small, large = beam_data("small", "solid"), beam_data("large", "solid", 30)
    flat = beam_data("large", "plane-stress", 30)
    datasets: Any = [[("one", small)], [("one", large), ("alone", flat), ("two", large)]]
    told: list[str] = []
    executor: Any = no_pool if is_pool else None
    found: Any = list(prediction.predict_on_each(datasets, told.append, executor))
    names = [["small one"], ["large one", "large alone alone", "large two"]]
    assert [(place, [p.name for p in predictions]) for place, predictions in found[-2:]] == list(enumerate(names))
    assert all(p.intervals == 1 for _, predictions in found[-2:] for p in predictions)
    every = [*names[0], *names[1]]
    first = dict(reversed(found[:-2]))
    assert [[p.name for p in first[place]] for place in (0, 1)] == names
    assert first[0][0].intervals == 0
    assert sorted(told) == sorted([*every, *(f"{name}, interval of its mean error" for name in every)])
    if is_pool:
        assert told[0] == "large one"  # the longest step comes first
    (alone,) = prediction.predict([("one", small)])  # type: ignore[list-item]
    assert alone == Predicted("small one", 1)


class Balanced(Prediction[Any]):
    # A prediction with an equilibrium.

    has_equilibrium = True  # type: ignore[assignment]


class Unbalanced(Prediction[Any]):
    # A prediction without an equilibrium.

    has_equilibrium = False  # type: ignore[assignment]


def test_the_interval_of_a_prediction_needs_an_equilibrium(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[Any] = []
    monkeypatch.setattr(prediction, "error_interval_mm", lambda *given: calls.append(given) or (0.1, 0.2))

    changed = SimpleNamespace(model_copy=lambda update: update)
    given = (SimpleNamespace(fit="fit"), "evidence", changed, "edges", "residuals", "errors", "deviations")
    one: Any = Balanced(*given)  # type: ignore[arg-type]
    none: Any = Unbalanced(*given)  # type: ignore[arg-type]
    assert prediction._with_interval(none) is none
    with_one: Any = prediction._with_interval(one)
    assert with_one.validation == {"mean_error_interval_mm": (0.1, 0.2)}
    assert calls == [("fit", "evidence", "residuals")]


def test_the_size_of_a_prediction_is_its_states_times_its_width_over_its_length() -> None:
    assert prediction._size([("law", beam_data("a", "solid", 8, 6.0))]) == pytest.approx(8 * 6.0 / 30.0)  # type: ignore[list-item]
    assert prediction._size([]) == 0.0


def fit_of(model: str, **more: Any) -> Any:
    values = {"neo-hookean": [40e3], "ogden": [30e3, 2.0, 1e3, 5.0, -2e3, -1.5]}.get(model, [40e3])
    given = {
        "model": model,
        "values": lambda: values,
        "initial_shear_modulus": Quantity(40e3, "Pa", (39e3, 41e3)),
        "caveats": lambda: ["a caveat"],
        "held_by_bounds": lambda: ("alpha",),
        "parameters": {
            "mu_Pa": Quantity(40e3, "Pa", (39123.456, 41e3)),
            "alpha": Quantity(-0.0, "1", (-0.0, 1.23456789)),
        },
        "datasets": (SimpleNamespace(in_words=lambda: "run.h5: 3 states", sha256="12ab", section="solid"),),
        "tensile": (SimpleNamespace(name="pull.csv", sha256="34cd"),),
        "max_stretch": 1.23456,
        "versions": {"eimi-lab": "9.8"},
        "time": None,
        **more,
    }
    return SimpleNamespace(**given)


def tensile_fit(window: str) -> Any:
    fit = TensileRecord.__new__(TensileRecord)
    for name, value in fit_of(
        "yeoh", window=lambda: window, source=SimpleNamespace(path="pull.csv", sha256="56ef"), max_stretch=1.5
    ).__dict__.items():
        object.__setattr__(fit, name, value)
    return fit


def test_the_fit_of_a_card_is_chosen_by_its_law_and_its_index() -> None:
    path = Path("fits.json")
    fits = [fit_of("yeoh"), fit_of("ogden"), tensile_fit("50 %")]
    assert export.choose_fit(path, fits, "ogden", None) is fits[1]
    assert export.choose_fit(path, fits, "ogden", 1) is fits[1]
    assert export.choose_fit(path, fits, "yeoh", 2) is fits[2]
    in_file = r"0 \(yeoh\), 1 \(ogden\), 2 \(yeoh, window 50 %\)"
    with pytest.raises(InputError, match=rf"^fits\.json: --model gent: should be one of the file's fits: {in_file}$"):
        export.choose_fit(path, fits, "gent", None)
    choices = r"--index 0 \(yeoh\), --index 2 \(yeoh, window 50 %\)"
    with pytest.raises(InputError, match=rf"^fits\.json: holds 2 fits of the law yeoh; give one of {choices}$"):
        export.choose_fit(path, fits, "yeoh", None)
    with pytest.raises(InputError, match=f"--index 1: should be the index of a yeoh fit; the file contains {in_file}$"):
        export.choose_fit(path, fits, "yeoh", 1)


def test_a_bulk_modulus_is_stated_in_kilopascal_or_as_a_ratio() -> None:
    fit = fit_of("yeoh")
    assert export.bulk_modulus_Pa(fit, "abaqus", 250.0, None) == 250e3
    assert export.bulk_modulus_Pa(fit, "abaqus", None, 2000.0) == 2000 * 40e3
    for given in ((None, None), (1.0, 2.0)):
        with pytest.raises(InputError, match="give either --bulk-modulus-kPa or --bulk-ratio"):
            export.bulk_modulus_Pa(fit, "abaqus", *given)
    for wrong in (0.0, -1.0, np.inf, np.nan):
        with pytest.raises(InputError, match=f"^--bulk-modulus-kPa {wrong}: should be a finite number above 0"):
            export.bulk_modulus_Pa(fit, "abaqus", wrong, None)
        with pytest.raises(InputError, match=f"^--bulk-ratio {wrong}: should be"):
            export.bulk_modulus_Pa(fit, "abaqus", None, wrong)
    assert export.bulk_modulus_Pa(fit, "abaqus", 1e-300, None) == pytest.approx(1e-297)
    assert export.check_solver("abaqus") == "abaqus"
    with pytest.raises(InputError, match=r"--to abacus: should be one of .*abaqus"):
        export.check_solver("abacus")


def test_a_card_has_the_size_of_the_instantaneous_modulus_and_the_relaxation(monkeypatch: pytest.MonkeyPatch) -> None:
    cards: list[Any] = []
    monkeypatch.setattr(export, "material_card", lambda solver, material: cards.append(material) or solver)
    assert export.card(Path("in/fits.json"), fit_of("ogden"), "abaqus", 8e7) == "abaqus"
    (plain,) = cards
    assert (plain.law, plain.bulk_modulus_Pa) == (LAWS["ogden"], 8e7)
    assert plain.parameters.tolist() == [30e3, 2.0, 1e3, 5.0, -2e3, -1.5]
    assert plain.name == "EIMI_OGDEN"
    assert plain.relaxation is None
    terms = [SimpleNamespace(g=0.2, tau_s=0.5), SimpleNamespace(g=0.1, tau_s=5.0)]
    time = SimpleNamespace(instantaneous_shear_modulus=Quantity(60e3, "Pa", (1.0, 2.0)), prony=terms)
    export.card(Path("fits.json"), fit_of("ogden", time=time), "abaqus", 8e7)
    assert cards[1].parameters.tolist() == pytest.approx([45e3, 2.0, 1.5e3, 5.0, -3e3, -1.5])
    assert cards[1].relaxation.g.tolist() == [0.2, 0.1]
    assert cards[1].relaxation.tau_s.tolist() == [0.5, 5.0]

    def missing(solver: str, material: Any) -> str:
        raise NotInSolver("abaqus has no such law")

    monkeypatch.setattr(export, "material_card", missing)
    with pytest.raises(InputError, match=r"^fits.json: ogden: abaqus has no such law"):
        export.card(Path("fits.json"), fit_of("ogden"), "abaqus", 8e7)


def test_the_comments_of_a_card_tell_its_data_and_its_intervals() -> None:
    intervals = [
        "mu_Pa 95 % interval 39123.5 to 41000 Pa",
        f"alpha 95 % interval 0 to 1.23457, {export.HELD}",
    ]
    end = "taken from fits.json by eimi-lab 9.8"
    assert export._origin(Path("in/fits.json"), fit_of("ogden"), "abaqus") == [
        "a caveat",
        *intervals,
        "fitted to bending up to a largest principal stretch of 1.235",
        "from run.h5: 3 states (sha256 12ab), solid",
        "and from the tensile test pull.csv (sha256 34cd)",
        end,
    ]
    assert export._origin(Path("fits.json"), tensile_fit("50 %"), "abaqus")[3:] == [
        "fitted to a uniaxial test up to a largest principal stretch of 1.5",
        "from pull.csv (sha256 56ef), window 50 %",
        end,
    ]
    ringing = RingDownRecord.__new__(RingDownRecord)
    for name, value in fit_of("ogden", versions={}).__dict__.items():
        object.__setattr__(ringing, name, value)
    assert export._origin(Path("fits.json"), ringing, "abaqus")[3:] == [
        "from run.h5: 3 states (sha256 12ab), solid",
        "taken from fits.json by eimi-lab",
    ]
