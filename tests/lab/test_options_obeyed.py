"""Every option of the command line reaches the function that does the work, and no input file is ever overwritten."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import h5py
import numpy as np
import pytest

from eimi_lab.config.rig import load_rig
from eimi_lab.dataset.layout import note
from eimi_lab.dataset.reading import open_dataset
from eimi_lab.dataset.stored_edges import write_edges
from eimi_lab.fits.checkpoint import Checkpoint, Head
from eimi_lab.fits.evidence import load_evidence
from eimi_lab.fits.options import FitOptions
from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.simulated_fit import FittedLaw
from eimi_lab.process.errors import InputError

Run = Callable[..., tuple[int, str]]

# A value that differs from the default, for every option of `eimi fit` that changes the result.
OTHERS: dict[str, Any] = {
    "section": "plane-stress",
    "include_flagged": True,
    "free": ["roll=0.2"],
    "prior": ["C10=20000,500"],
    "tensile": ["curve.csv"],
    "tensile_window": "20",
    "tensile_weight": 0.5,
    "restarts": 2,
    "bipop": True,
    "time": "prony",
}


@pytest.fixture
def curve(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    # The file of a tensile curve in the working directory of the test.
    rows = [f"{e:.2f},{60 * (1 + e - (1 + e) ** -2):.4f}" for e in np.linspace(0.02, 0.8, 40)]
    (tmp_path / "curve.csv").write_text("\n".join(["strain,stress_kPa", *rows]) + "\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path / "curve.csv"


def options(**changes: Any) -> FitOptions:
    # Return the options of a fit with `changes`, and with a tensile curve if an option requires one.
    if changes.keys() & {"tensile", "tensile_window", "tensile_weight"}:
        changes["tensile"] = [Path("curve.csv")]
    return FitOptions(**changes)


def test_this_file_contains_another_value_for_every_option_of_a_fit() -> None:
    assert OTHERS.keys() == {field.name for field in dataclasses.fields(FitOptions)}


@pytest.mark.parametrize("name", OTHERS)
def test_a_checkpoint_is_not_continued_with_another_option(curve: Path, tmp_path: Path, name: str) -> None:
    before = FitOptions(tensile=[Path("curve.csv")]) if name in ("tensile_window", "tensile_weight") else FitOptions()
    after = options(**{name: OTHERS[name]})
    assert before.head() != after.head()
    assert after.head()[name] not in (None, False, 0, [])

    def head(chosen: FitOptions) -> Head:
        return Head(fits=("one",), datasets=("0" * 64,), options=chosen.head(), versions={"numpy": "1"})

    log = tmp_path / "log.jsonl"
    Checkpoint(log, head(before), resume=False)
    Checkpoint(log, head(before), resume=True)
    with pytest.raises(InputError, match="should be the same"):
        Checkpoint(log, head(after), resume=True)


@pytest.mark.parametrize("change", [{"datasets": ("1" * 64,)}, {"fits": ("two",)}, {"versions": {"numpy": "2"}}])
def test_a_checkpoint_is_not_continued_with_other_data(tmp_path: Path, change: dict[str, Any]) -> None:
    one = {"fits": ("one",), "datasets": ("0" * 64,), "options": {"seed": 1}, "versions": {"numpy": "1"}}
    log = tmp_path / "log.jsonl"
    Checkpoint(log, Head(**one), resume=False)
    with pytest.raises(InputError, match="should be the same"):
        Checkpoint(log, Head(**one | change), resume=True)


def test_resume_continues_a_checkpoint_force_replaces_it_and_without_both_it_is_kept(tmp_path: Path) -> None:
    head = Head(fits=("one",), datasets=("0" * 64,), options=FitOptions().head(), versions={"numpy": "1"})
    log = tmp_path / "log.jsonl"
    Checkpoint.of(log, head, resume=False, force=False)
    begun = log.read_text()
    log.write_text(begun + "\nwhat the fit has stored\n")
    with pytest.raises(InputError, match="exists already; give --resume to continue it, --force to replace it"):
        Checkpoint.of(log, head, resume=False, force=False)
    Checkpoint.of(log, head, resume=True, force=False)
    Checkpoint.of(log, head, resume=True, force=True)
    assert log.read_text() == begun + "\nwhat the fit has stored\n"
    Checkpoint.of(log, head, resume=False, force=True)
    assert log.read_text() == begun
    with pytest.raises(InputError, match="--resume: give the checkpoint of the interrupted fit"):
        Checkpoint.of(None, head, resume=True, force=False)


def test_every_option_of_a_fit_reaches_the_mathematics(curve: Path) -> None:
    chosen = options(free=["roll=0.2", "bulk"], tensile_window="20", tensile_weight=0.5, restarts=2, bipop=True)
    passed = chosen.for_identify()
    assert (passed["restarts"], passed["bipop"], passed["free_bulk"]) == (2, True, True)
    assert [(prior.kind, prior.spread) for prior in passed["free"]] == [("roll", 0.2)]
    (own,) = passed["tensile"]
    assert (own.weight, own.strain.max()) == (0.5, pytest.approx(0.2))
    assert FitOptions().for_identify() == {
        "free": (),
        "free_bulk": False,
        "tensile": (),
        "priors": (),
        "restarts": 0,
        "bipop": False,
    }


@dataclasses.dataclass
class Reached:
    # The positional and named arguments with which a command called a function.

    given: tuple[Any, ...]
    named: dict[str, Any]


@pytest.fixture
def reached(monkeypatch: pytest.MonkeyPatch, run: Run) -> Callable[..., tuple[tuple[Any, ...], dict[str, Any]]]:
    # Return a function that runs a command up to its call of a given function, and returns the arguments.
    def reached(function: str, *arguments: object) -> tuple[tuple[Any, ...], dict[str, Any]]:
        calls: list[Reached] = []

        def stop(*given: Any, **named: Any) -> None:
            calls.append(Reached(given, named))
            raise InputError("the test stops the command here")

        with monkeypatch.context() as patch:
            patch.setattr(f"eimi_lab.{function}", stop)
            status, message = run(*arguments)
        assert status == 2
        assert calls, message
        return calls[0].given, calls[0].named

    return reached


def test_fit_and_validate_obey_include_flagged_and_section(
    reached: Any, dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("eimi_lab.face.using.fits_of", lambda fits: [])
    (tmp_path / "fits.json").write_text("{}")
    fit = ("fit", dataset, "--model", "yeoh", "-o", tmp_path / "new.json")
    validate = ("validate", dataset, "--fit", tmp_path / "fits.json", "-o", tmp_path / "new.json")
    for command, load in ((fit, "fits.evidence.load_evidence"), (validate, "face.using.load_evidence")):
        _, plain = reached(load, *command)
        assert (plain["section"], plain["flagged"]) == (None, False)
        _, chosen = reached(load, *command, "--include-flagged", "--section", "plane-strain")
        assert (chosen["section"], chosen["flagged"]) == ("plane-strain", True)


def test_simulate_obeys_its_angles_and_uses_the_default_coil_constant_of_its_help(reached: Any, tmp_path: Path) -> None:
    command = ("simulate", "dragon_skin_10", "--specimen", "type1", "--model", "neo-hookean")
    command += ("--parameter", "mu_Pa=46e3", "-o", tmp_path / "out")
    given, _ = reached("face.using.simulated", *command)
    assert given[3] == pytest.approx(4.7 * np.linspace(0, 1.5, 16))
    assert given[4:7] == (0.0, 90.0, None)
    more = ("--coil-constant", "2", "--gravity-angle", "30", "--field-angle", "60", "--bulk-modulus-kPa", "900")
    given, _ = reached("face.using.simulated", *command, *more)
    assert given[3] == pytest.approx(2.0 * np.linspace(0, 1.5, 16))
    assert given[4:7] == (30.0, 60.0, 900.0)


def test_tensile_demo_plan_and_acquire_obey_their_options(
    reached: Any, curve: Path, files: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tensile = ("tensile", curve, "--model", "yeoh", "--window", "20", "-o", "new.json")
    for more, relative in ((), False), (("--relative",), True):
        given, _ = reached("fits.tensile_fits.fit_window", *tensile, *more)
        assert given[1:] == ("yeoh", 20.0, relative)
    _, named = reached("face.demonstrating.demonstrate", "demo", "--quick", "--seed", "7", "-o", "here")
    assert (named["seed"], named["quick"]) == (7, True)
    fitted_law = FittedLaw(Path("fits.json"), 0, cast(FitRecord, None))
    monkeypatch.setattr("eimi_lab.face.using.fits_of", lambda fits: [fitted_law])
    plan = ("plan", "fits.json", "dragon_skin_10", "--specimen", "bench_example", "--rig", "bench_example")
    plan += ("-o", "planned.toml")
    given, _ = reached("fits.planning.Goal.of", *plan, "--goal", "yeoh", "--model", "ogden")
    assert given[2:] == ("ogden", "yeoh")
    bench = ("acquire", files / "protocol.toml", "--specimen", "type1", "--rig", "virtual", "-o", "run.h5")
    for more, words, take_over in ((), "", False), (("--note", "cold", "--take-over"), "cold", True):
        _, named = reached("acquisition.run.acquire", *bench, *more)
        assert (named["note"], named["take_over"], named["resume"]) == (words, take_over, False)


def test_calibrate_obeys_its_options_for_board_beam_and_gravity(reached: Any, files: Path) -> None:
    picture = files / "board.png"
    picture.write_bytes(b"")
    common = ("--coil-constant", "4.7", "--clamp-midpoint-px", "64", "8", "-o", files / "new.toml")
    board = ("calibrate", picture, "--board", "charuco", *common)
    given, _ = reached("vision.calibration.calibration_file.from_board", *board)
    setup = given[3]
    assert (setup.axis_angle_deg, setup.gravity_angle_deg, setup.field_angle_deg) == (90.0, 90.0, 0.0)
    assert given[4] == pytest.approx(1e-3)
    more = ("--board-error-percent", "0.5", "--gravity-angle", "80", "--axis-angle", "70", "--field-angle", "10")
    given, _ = reached("vision.calibration.calibration_file.from_board", *board, *more)
    setup = given[3]
    assert (setup.axis_angle_deg, setup.gravity_angle_deg, setup.field_angle_deg) == (70.0, 80.0, 10.0)
    assert given[4] == pytest.approx(5e-3)
    beam = ("calibrate", picture, "--specimen", files / "specimen.toml", "--width-tolerance-mm", "0.2", *common)
    given, _ = reached("vision.calibration.calibration_file.from_beam", *beam)
    assert given[3] == 0.2


@pytest.mark.parametrize(
    "command",
    [
        "fit a.h5 --model yeoh -o a.h5",
        "fit a.h5 --model yeoh --checkpoint a.h5 -o new.json",
        "fit a.h5 --model yeoh --tensile b.csv -o b.csv",
        "validate a.h5 --fit f.json -o a.h5",
        "validate a.h5 --fit f.json -o f.json",
        "tensile b.csv --model yeoh -o b.csv",
        "export f.json --model yeoh --to abaqus --bulk-ratio 2000 -o f.json",
        "report a.h5 --fit f.json -o a.h5",
        "report a.h5 --fit f.json -o f.json",
        "plan f.json p.toml --specimen s.toml --rig r.toml -o f.json",
        "plan f.json p.toml --specimen s.toml --rig r.toml -o p.toml",
        "plan f.json p.toml --specimen s.toml --rig r.toml -o s.toml",
        "plan f.json p.toml --specimen s.toml --rig r.toml -o r.toml",
        "import pictures --states b.csv --specimen s.toml --calibration c.toml -o b.csv",
        "import pictures --states b.csv --specimen s.toml --calibration c.toml -o c.toml",
        "import pictures --states b.csv --specimen s.toml --calibration c.toml -o s.toml",
        "import t.csv --states b.csv --specimen s.toml --gravity-angle 0 -o t.csv",
        "calibrate x.png --board charuco --coil-constant 4.7 --clamp-midpoint-px 1 1 -o x.png",
        "calibrate x.png --specimen s.toml --coil-constant 4.7 --clamp-midpoint-px 1 1 -o s.toml",
        "acquire p.toml --specimen s.toml --rig r.toml -o p.toml",
        "acquire p.toml --specimen s.toml --rig r.toml -o s.toml",
    ],
)
@pytest.mark.parametrize("through", ["by name", "by a link"])
def test_a_file_that_a_command_reads_is_never_overwritten_even_with_force(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run: Run, command: str, through: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pictures").mkdir()
    for name in ("a.h5", "b.csv", "c.toml", "f.json", "p.toml", "r.toml", "s.toml", "t.csv", "x.png"):
        (tmp_path / name).write_text(f"what {name} holds")
    arguments = command.split()
    if through == "by a link":
        place = arguments.index("--checkpoint" if "--checkpoint" in arguments else "-o") + 1
        (tmp_path / "link").symlink_to(arguments[place])
        arguments[place] = "link"
    status, message = run(*arguments, "--force")
    assert status == 2
    assert message.count("\n") == 1
    assert "the same command already reads or writes this file" in message
    for name in ("a.h5", "b.csv", "c.toml", "f.json", "p.toml", "r.toml", "s.toml", "t.csv", "x.png"):
        assert (tmp_path / name).read_text() == f"what {name} holds"


@pytest.mark.parametrize(
    "command",
    [
        "fit a.h5 --model yeoh",
        "discover a.h5",
        "validate a.h5 --fit f.json",
        "tensile b.csv --model yeoh",
        "report a.h5 --fit f.json",
        "plan f.json p.toml --specimen s.toml --rig r.toml",
        "calibrate x.png --board charuco --coil-constant 4.7 --clamp-midpoint-px 1 1",
        "calibrate x.png --specimen s.toml --coil-constant 4.7 --clamp-midpoint-px 1 1",
    ],
)
def test_an_existing_result_is_refused_before_any_input_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run: Run, command: str
) -> None:
    # The inputs are no valid files.
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pictures").mkdir()
    for name in ("a.h5", "b.csv", "c.toml", "f.json", "p.toml", "r.toml", "s.toml", "t.csv", "x.png", "old"):
        (tmp_path / name).write_text(f"what {name} holds")
    status, message = run(*command.split(), "-o", "old")
    assert (status, message.count("\n")) == (2, 1)
    assert "old: exists already; give another name, or --force to replace it" in message
    assert (tmp_path / "old").read_text() == "what old holds"


def test_states_that_their_run_has_flagged_are_left_out_unless_an_option_includes_them(dataset: Path) -> None:
    # The second state was flagged by its run, and gets the good edges of the first state.
    load_evidence(dataset, flagged=True)  # detects and stores the edges
    with open_dataset(dataset) as opened:
        first = (opened.edges() or ())[0]
    write_edges(dataset, [dataclasses.replace(first, flags=())] * 2)
    used = load_evidence(dataset, flagged=True).used
    assert (used.total, used.left_out) == (2, ())
    left_out = load_evidence(dataset).used.left_out
    assert [(state.state, state.flags) for state in left_out] == [(1, ("NOT_SETTLED",))]


def test_the_uncertainty_of_the_current_that_a_rig_states_reaches_the_fit(dataset: Path) -> None:
    load_evidence(dataset, flagged=True)  # detects and stores the edges
    rig = load_rig("bench_example")
    with h5py.File(dataset, "r+", libver="latest") as file:
        note(file["entry"], "rig", rig.text, "application/toml")
    stated = {source.source: source for source in load_evidence(dataset, flagged=True).experiment.stated}
    assert rig.uncertainty is not None
    assert stated["offset"].standard_uncertainty == pytest.approx(4.7 * rig.uncertainty["current_A"])  # mT


def test_a_file_name_that_no_result_can_store_is_refused_before_the_work() -> None:
    with pytest.raises(InputError, match=r"udcff\.h5': is not UTF-8"):
        load_evidence("\udcff.h5")
