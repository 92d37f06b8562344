"""`eimi plan` writes a protocol of the planned states; an impossible plan gives an error of one line."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from eimi_fitting import LAWS, BeamModel, Experiment, Loads, PointObservation, Specimen, identify
from eimi_fitting.inference.evidence.quantity import NORMAL_95
from eimi_fitting.inference.planning.design_of_experiment import KnownLaw
from eimi_lab.config.protocol import Protocol, load_protocol
from eimi_lab.config.rig import load_rig
from eimi_lab.config.specimen import load_specimen
from eimi_lab.dataset.state import State
from eimi_lab.fits import planning
from eimi_lab.fits.evidence import Evidence
from eimi_lab.fits.fits_file import Fits, read_fits_file
from eimi_lab.fits.planned_ring_down import expected_ring_down
from eimi_lab.fits.planning import Goal
from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.states_used import StatesUsed
from eimi_lab.process.errors import InputError

ARGUMENTS = ("dragon_skin_10_quick", "--rig", "virtual")


@pytest.fixture(scope="module")
def fits(tmp_path_factory: pytest.TempPathFactory) -> Path:
    # The results file of a neo-Hookean fit to a silicone strip under two weights.
    strip = Specimen(30.0, 3.0, 10.0, 1070.0, "plane-stress")
    model, loads = BeamModel(strip), Loads.along([0.0, 0.0], gravity_angle_deg=90.0, tip_force_N=[0.001, 0.002])
    rest = np.column_stack([np.linspace(5, 29, 9), np.zeros(9)])
    moved = model.positions(model.solve(LAWS["neo-hookean"], np.array([[46e3]]), loads), rest)[0]
    moved += np.random.default_rng(1).normal(0, 0.01, moved.shape)
    experiment = Experiment(model, loads, PointObservation(np.tile(rest, (2, 1, 1)), moved, np.full((2, 9), 0.01)))
    states = tuple(State(index, 0.0, None, 0.0, force, ()) for index, force in enumerate((0.001, 0.002)))
    evidence = Evidence(Path("strip.h5"), "0" * 64, experiment, states, StatesUsed(2, (), ()))
    path = tmp_path_factory.mktemp("plan") / "fits.json"
    Fits.of([FitRecord.of(identify("neo-hookean", [experiment]), [evidence])]).write(path)
    return path


def test_a_planned_protocol_contains_its_states_and_its_mounting(
    fits: Path, run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "planned.toml"
    mounting = ("--gravity-angle", 90, "--gravity-angle", 0, "--tip-weight", 2)
    assert run("plan", fits, *ARGUMENTS, "--specimen", "type1", "--states", 3, *mounting, "-o", out)[0] == 0
    protocol = load_protocol(out)
    assert len(protocol.currents_A) == 3
    assert max(protocol.currents_A) <= protocol.limits.current_A
    assert protocol.tip_force_N == pytest.approx(2e-3 * 9.80665)
    assert "# Mounting: type1, gravity at " in out.read_text()
    # The virtual rig does not simulate weights.
    status, message = run("acquire", out, "--specimen", "type1", "--rig", "virtual", "-o", tmp_path / "run.h5")
    assert (status, "a virtual beam has no weight" in message) == (2, True)


def test_the_plan_is_printed_as_json(fits: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys) -> None:
    from eimi_lab import cli

    arguments = ["plan", fits, *ARGUMENTS, "--specimen", "type1", "--states", 3, "--json", "-o", tmp_path / "p.toml"]
    monkeypatch.setattr("sys.argv", ["eimi", *map(str, arguments)])
    monkeypatch.setattr(cli, "unwind_on_termination", lambda: None)
    with pytest.raises(SystemExit):
        cli.main()
    (planned,) = json.loads(capsys.readouterr().out)["runs"]
    assert planned["expected"] < 0.99 * planned["equally_spaced"]  # a state without a current would contribute nothing
    assert len(planned["currents_A"]) == 3
    assert planned["ring_down"]["without_percent"] == planned["expected"]


def test_a_ring_down_removes_the_uncertainty_of_the_moment(fits: Path, run, tmp_path: Path) -> None:
    known_law = KnownLaw(LAWS["neo-hookean"], np.array([46.4e3]))
    specimen = load_specimen("bench_example")
    beam, stated = specimen.mechanics(), specimen.stated_sources()
    static = {"remanence": -5.0, "width": -2.0}
    whole = NORMAL_95 * np.hypot(5.0, 2.0)
    expected = expected_ring_down(known_law, beam, 0.0, 0.0, stated, whole, static)
    assert expected is not None
    assert expected.with_percent < 0.6 * whole
    assert expected.moment_percent is not None
    # A ring-down does not contain the moment: nothing changes if its stated uncertainty is larger.
    less_known = expected_ring_down(
        known_law, beam, 0.0, 0.0, stated, NORMAL_95 * np.hypot(9.0, 2.0), {**static, "remanence": 9.0}
    )
    assert less_known is not None
    assert less_known.dynamic_percent == expected.dynamic_percent
    assert less_known.moment_percent is not None
    assert expected.moment_percent < less_known.moment_percent < less_known.moment_share_percent
    assert expected.moment_percent < expected.moment_share_percent
    assert expected.with_percent <= less_known.with_percent < 1.25 * expected.with_percent


def test_both_polarities_are_planned_where_the_direction_of_magnetisation_is_uncertain(
    fits: Path, run, tmp_path: Path
) -> None:
    specimen, out = tmp_path / "specimen.toml", tmp_path / "planned.toml"
    exact = Path("protocols/specimens/type1.toml").read_text()
    specimen.write_text(exact.replace("\nmagnetisation_angle_deg = 0.0", "\nmagnetisation_angle_deg = 1.7"))
    arguments = ("plan", fits, *ARGUMENTS, "--specimen", specimen, "--states", 4, "--force", "-o", out)
    assert run(*arguments)[0] == 0
    one = half_width(out.read_text().splitlines()[0])
    assert not load_protocol(out).current.both_polarities
    assert run(*arguments, "--both-polarities")[0] == 0
    assert half_width(out.read_text().splitlines()[0]) < 0.5 * one
    protocol = load_protocol(out)
    assert protocol.current.both_polarities
    assert len(protocol.currents_A) == 4
    assert sum(protocol.currents_A) == pytest.approx(0.0)


def test_a_plan_without_a_number_of_states_has_as_many_as_the_protocol() -> None:
    protocol = cast("Protocol", SimpleNamespace(currents_A=(0.0, 0.1, 0.2, 0.3, 0.4)))
    assert [planning.number_of_states(None, protocol, both) for both in (False, True)] == [5, 5]
    assert planning.number_of_states(2, protocol, both_polarities=False) == 2
    for few in (0, 1):
        with pytest.raises(InputError, match=f"--states {few}: should be at least 2"):
            planning.number_of_states(few, protocol, both_polarities=False)


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        (("--goal", "C10"), "--goal C10: should be modulus, one of neo-hookean's parameters (mu)"),
        (("--model", "yeoh"), "--model yeoh: should be one of neo-hookean"),
        (("--states", "99"), "--states 99: should be at most 41"),
        *(
            (
                ("--states", few, "--both-polarities"),
                f"--states {few}: with --both-polarities, should be an even number",
            )
            for few in ("2", "3", "5")
        ),
    ],
)
def test_an_impossible_plan_is_refused_in_one_line(
    fits: Path, run, tmp_path: Path, more: tuple[str, ...], expected: str
) -> None:
    status, message = run("plan", fits, *ARGUMENTS, "--specimen", "type1", *more, "-o", tmp_path / "planned.toml")
    assert (status, message.count("\n"), expected in message) == (2, 1, True), message
    assert not (tmp_path / "planned.toml").exists()


def planned(fits: Path, folder: Path, run, protocol_A: float, rig_A: float, unsure_A: float = 0.0) -> tuple[str, float]:
    # Plan a run; return the heading and the highest current (A) of the planned protocol.
    # protocol_A, rig_A: limits of the current. unsure_A: standard uncertainty of the current.
    for path in Path("protocols/rigs").glob("virtual*.toml"):
        (folder / path.name).write_text(path.read_text())
    rig, protocol, out = folder / "virtual.toml", folder / "protocol.toml", folder / "planned.toml"
    text = rig.read_text().replace("limits = { current_A = 2.0", f"limits = {{ current_A = {rig_A}")
    rig.write_text(text.replace("\ncurrent_A = 0.0 ", f"\ncurrent_A = {unsure_A} "))
    text = Path("protocols/dragon_skin_10_quick.toml").read_text().replace("stop_A = 1.5", "stop_A = 0.3")
    protocol.write_text(text.replace("current_A = 1.6\n", f"current_A = {protocol_A}\n", 1))
    assert load_rig(rig).supply.limits.current_A == rig_A
    assert load_protocol(protocol).limits.current_A == protocol_A
    arguments = ("plan", fits, protocol, "--rig", rig, "--specimen", "type1", "--states", 2, "--force", "-o", out)
    assert run(*arguments)[0] == 0
    return out.read_text().splitlines()[0], max(load_protocol(out).currents_A)


def half_width(heading: str) -> float:
    # Return the expected half-width (%) of the interval of the modulus from the heading of a plan.
    return float(heading.split("±")[1].split("%")[0])


@pytest.mark.parametrize(("protocol_A", "rig_A"), [(0.5, 2.0), (2.0, 0.5)])
def test_a_plan_obeys_the_stricter_of_the_two_current_limits(
    fits: Path, run, tmp_path: Path, protocol_A, rig_A
) -> None:
    # Without the two limits the highest current would be 0.68 A.
    assert 0.4 < planned(fits, tmp_path, run, protocol_A, rig_A)[1] <= 0.5


@pytest.mark.parametrize("limit_A", [1.0006, 0.01])
def test_the_currents_of_a_plan_differ_and_obey_a_limit_between_whole_milliamperes(limit_A: float) -> None:
    protocol = load_protocol("dragon_skin_10_quick")
    limits = protocol.limits.model_copy(update={"current_A": limit_A})
    currents_A = planning._currents(load_rig("virtual"), protocol.model_copy(update={"limits": limits}))
    assert (currents_A[0], currents_A[-1]) == (0.0, np.floor(1000 * limit_A) / 1000)
    assert (np.diff(currents_A) > 0).all()


def test_the_currents_of_a_plan_are_multiples_of_the_step_of_the_supply() -> None:
    rig = load_rig("bench_example")
    supply = rig.supply.model_copy(update={"driver": "kepco-bop"})
    protocol = load_protocol("dragon_skin_10_quick")
    limits = protocol.limits.model_copy(update={"current_A": 1.019})
    currents_A = planning._currents(
        rig.model_copy(update={"supply": supply}), protocol.model_copy(update={"limits": limits})
    )
    assert (currents_A[0], currents_A[-1]) == (-1.01, 1.01)
    assert all(current in currents_A for current in (0.0, 0.05, -0.05))
    assert [round(current, 2) for current in currents_A] == list(currents_A)


def test_the_uncertainty_of_the_current_is_in_the_expected_interval(fits: Path, run, tmp_path: Path) -> None:
    sure, unsure = (half_width(planned(fits, tmp_path, run, 1.6, 2.0, unsure_A)[0]) for unsure_A in (0.0, 0.05))
    # 0.05 A of 0.7 A changes the torque, and thus the modulus, by several per cent.
    assert unsure > sure + 3.0


@pytest.mark.parametrize("against_a_rival", [False, True])
def test_the_best_mounting_comes_first(monkeypatch: pytest.MonkeyPatch, against_a_rival: bool) -> None:
    # The runs differ in the direction of gravity; the best one has the narrowest interval of the modulus.
    expected = {0.0: 3.0, 90.0: 1.0, 180.0: 2.0}
    specimen, rig, protocol = load_specimen("type1"), load_rig("virtual"), load_protocol("dragon_skin_10_quick")
    fit = SimpleNamespace(model="yeoh")
    goal = Goal(
        cast(FitRecord, fit), rival=cast(FitRecord, SimpleNamespace(model="ogden")) if against_a_rival else None
    )

    def of_mounting(goal: Goal, mounting: planning.Mounting, *rest: object) -> planning.PlannedRun:
        value = expected[mounting.gravity_angle_deg or 0.0]
        return planning.PlannedRun(mounting, (0.1, 0.25), value, 10.0 * value, {"coil constant": 0.4, "width": 0.0})

    monkeypatch.setattr(planning, "_planned", of_mounting)
    monkeypatch.setattr(planning, "_with_ring_down", lambda goal, run, rig: run)  # the fit has no parameters
    runs = planning.plan(
        goal, planning.mountings([specimen], rig, list(expected), [], both_polarities=False), rig, protocol, 2
    )
    angles = [run.mounting.gravity_angle_deg for run in runs]
    assert angles == ([0.0, 180.0, 90.0] if against_a_rival else [90.0, 180.0, 0.0])
    head, *rows, best, sources = planning.table(goal, runs)[1:]
    assert head.split() == ["mounting", "planned", "equally", "spaced"]
    values = ["3 30", "2 20", "1 10"] if against_a_rival else ["± 1 % ± 10 %", "± 2 % ± 20 %", "± 3 % ± 30 %"]
    assert [
        " ".join(row.split()).removeprefix(run.mounting.in_words()).strip() for run, row in zip(runs, rows, strict=True)
    ] == values
    assert best.endswith("currents 0.1, 0.25 A")
    assert best.startswith(f"best run: type1, gravity at {angles[0]:g}°")
    assert sources == (
        "largest sources of uncertainty, each with the standard deviation of the modulus that it causes: coil "
        "constant 0.4 %"
    )
    planned_runs = planning.content(goal, runs)["runs"]
    assert [(run["gravity_angle_deg"], run["expected"], run["equally_spaced"]) for run in planned_runs] == [
        (angle, expected[angle], 10.0 * expected[angle]) for angle in angles
    ]


def test_a_plan_includes_the_remaining_error_of_the_solid_in_an_earlier_fit(fits: Path) -> None:
    (fit,) = read_fits_file(fits).fits
    assert isinstance(fit, FitRecord)
    assert planning._noise(fit).left_percent == 0.0
    mesh = fit.mesh
    assert mesh is not None
    solid = replace(fit, section_change=replace(mesh, left_percent=0.7))
    assert planning._noise(solid).left_percent == 0.7
    assert planning._noise(solid).points == fit.identifiability.points / len(fit.by_state)
