"""Sentences, checks and tables of fits change exactly at their documented thresholds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_fitting import LAWS, Loads, Specimen
from eimi_fitting.inference.evidence.measurements import EdgeObservation, PointObservation
from eimi_fitting.inference.evidence.quantity import NORMAL_95, Quantity
from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_fitting.inference.planning.choice_of_law import Choice
from eimi_fitting.inference.planning.design_of_experiment import Candidates, KnownLaw
from eimi_fitting.inference.planning.rival_laws import Rivals
from eimi_lab.dataset.state import State
from eimi_lab.fits import (
    assumptions,
    before_search,
    checkpoint,
    fit_summary,
    planned_ring_down,
    planning,
    tensile_files,
    tensile_fits,
    time_records,
    validation_tables,
)
from eimi_lab.fits.bootstrap_record import BootstrapRecord, ReplicateRecord
from eimi_lab.fits.grades import grade
from eimi_lab.fits.law_record import LawRecord
from eimi_lab.fits.measured_conditions import stated_by_measurement
from eimi_lab.fits.measured_record import MeasuredField, MeasuredTemperature
from eimi_lab.fits.measured_remarks import measured_differences, measured_lines
from eimi_lab.fits.perspective import seen_depth
from eimi_lab.fits.residuals import Residuals, _along_mm, _arc_length_mm
from eimi_lab.fits.states_used import FlaggedState, StatesUsed, WidenedState
from eimi_lab.fits.validation import FitReference
from eimi_lab.process.errors import InputError


def field(mT_per_A: float = 5.0, sigma: float = 0.01, **more: Any) -> MeasuredField:
    given: dict[str, Any] = {
        "source": "probe 1", "mT_per_A": mT_per_A, "mT_per_A_sigma": sigma, "offset_mT": 0.05,
        "offset_mT_sigma": 0.002, "scatter_mT": 0.01, "currents": 9, "scale_is_stated": True,
    }  # fmt: skip
    return MeasuredField(**(given | more))


def dataset(path: str, degC: float | None = None, of: MeasuredField | None = None) -> Any:
    warm = None if degC is None else MeasuredTemperature(mean_degC=degC, lowest_degC=degC, highest_degC=degC, states=1)
    return SimpleNamespace(path=path, temperature=warm, measured_field=of)


def test_temperatures_that_differ_by_more_than_two_kelvin_are_reported() -> None:
    assert measured_differences([dataset("a", 20.0), dataset("b", 22.0), dataset("c")]) == []
    (words,) = measured_differences([dataset("a", 20.0), dataset("b", 22.1)])
    assert words == (
        "a was measured at 20.0 °C and b at 22.1 °C: they differ by more than 2 K, but the fit assumes equal materials"
    )
    assert len(measured_differences([dataset("a", 20.0), dataset("b", 25.0), dataset("c", 15.0)])) == 3


def test_coil_constants_that_differ_by_more_than_three_standard_uncertainties_are_reported() -> None:
    three = 3 * np.hypot(0.01, 0.02)
    for more, count in ((0.99, 0), (1.01, 1), (-1.01, 1)):
        found = measured_differences([dataset("a", of=field()), dataset("b", of=field(5.0 + more * three, 0.02))])
        assert len(found) == count
    assert found[0].startswith("a has 5 mT/A and b has 4.9322 mT/A: they differ by -1.4 %, more than 3 standard")
    lines = measured_lines([dataset("a", 21.25, field(stated_mT_per_A=4.0, scale_is_stated=False))])
    assert lines == [
        "a: the fit uses the field that probe 1 measured at 9 currents, 5 ± 0.01 mT/A, and 0.05 ± 0.002 mT without a "
        "current, in place of coil_constant_mT_per_A = 4 (+25.0 %); the scale of the gaussmeter is taken as exact, "
        "because the rig file gives no uncertainty_share",
        "a: the specimen was at 21.2 °C",
    ]
    assert field(stated_mT_per_A=0.0).in_words.endswith("in place of coil_constant_mT_per_A = 0")
    assert field().in_words.endswith("mT without a current")


def test_the_measured_temperature_has_its_range() -> None:
    def states(*degC: float | None) -> Any:
        return SimpleNamespace(states=[SimpleNamespace(temperature_degC=one) for one in degC])

    assert MeasuredTemperature.of(states(None)) is None
    found = MeasuredTemperature.of(states(20.0, None, 23.0))
    assert found is not None
    assert (found.mean_degC, found.lowest_degC, found.highest_degC, found.states) == (21.5, 20.0, 23.0, 2)
    assert found.in_words == "21.5 °C, from 20.0 to 23.0"
    assert MeasuredTemperature.of(states(20.0)).in_words == "20.0 °C"  # type: ignore[union-attr]


def test_measured_fields_give_the_uncertainty_of_the_strongest_and_the_weakest_field() -> None:
    def stated(*fields: tuple[float, float | None]) -> list[tuple[str, float]]:
        states = [SimpleNamespace(field_mT=mT, field_sigma_mT=sigma) for mT, sigma in fields]
        data: Any = SimpleNamespace(field_line=None, path=Path("run.h5"))
        return [(one.source, one.standard_uncertainty) for one in stated_by_measurement(data, states)]  # type: ignore[arg-type]

    assert stated((0.1, 0.01), (-5.0, 0.1), (2.0, 0.05), (9.0, None)) == [("coil", 0.02), ("offset", 0.01)]
    assert stated((0.0, 0.01)) == [("offset", 0.01)]
    assert stated((1.0, None)) == []
    line = SimpleNamespace(mT_per_A=-5.0, mT_per_A_sigma=0.1, offset_mT_sigma=0.003, probe="probe 1")
    found = stated_by_measurement(SimpleNamespace(field_line=line), ())  # type: ignore[arg-type]
    assert [(one.source, one.standard_uncertainty, one.of) for one in found] == [
        ("coil", 0.02, "probe 1"), ("offset", 0.003, "probe 1")
    ]  # fmt: skip


def validation(error_mm: float | None, low_mm: float | None = None, **more: Any) -> Any:
    interval = None if low_mm is None else (low_mm, None)
    given = {"seen": False, "dataset": "other.h5", "mean_error_mm": error_mm, "mean_error_interval_mm": interval}
    return SimpleNamespace(**(given | more))


def graded(*unseen: Any, **more: Any) -> str:
    fit: Any = SimpleNamespace(**({
        "held_by_bounds": lambda: (), "doubts_in_words": list, "budget": ("width",), "mean_error_mm": 0.01,
        "held_out_error_mm": 0.0149,
    } | more))  # fmt: skip
    return grade(fit, unseen).name


def test_a_fit_is_graded_by_its_data_doubts_and_predictions() -> None:
    assert graded(held_by_bounds=lambda: ("initial_shear_modulus",)) == "not determined"
    assert graded(held_by_bounds=lambda: ("C20",)) == "predicted unseen states"
    assert graded(doubts_in_words=lambda: ["the clamp moved"]) == "doubted"
    assert graded(budget=()) == "noise only"
    assert graded(held_out_error_mm=0.0151) == graded(held_out_error_mm=None) == "budget stated"
    assert graded(validation(0.0149)) == "predicted an unseen specimen"
    assert graded(validation(0.0151)) == "predicted unseen states"
    assert graded(validation(0.1, 0.0149)) == "predicted an unseen specimen"  # the interval of the error contains 15 µm
    assert graded(validation(0.1, 0.0151)) == graded(validation(None)) == "predicted unseen states"
    assert graded(validation(0.1, seen=True)) == "predicted unseen states"
    assert graded(validation(0.001), validation(0.1)) == "predicted unseen states"


def edges_of_a_beam(states: int, stand_off_mm: float, scatter_mm: float = 0.0) -> EdgeObservation:
    # Return the edges of a beam 4 mm wide and 6 mm deep, seen through an ordinary lens.
    # The nearer faces, which bound the beam in the picture, are by half of the depth nearer to the lens than the
    # middle.
    rng, along = np.random.default_rng(1), np.linspace(0.0, 40.0, 81)
    points = np.zeros((states, 2, 81, 2))
    for k in range(states):
        middle = 2.0 * k + 0 * along
        for side, sign in enumerate((-1.0, 1.0)):
            edge = middle + 2.0 * sign
            points[k, side] = np.stack([along, edge + 3.0 / stand_off_mm * np.abs(edge - 5.0) * sign], axis=1)
    points += scatter_mm * rng.standard_normal(points.shape)
    return EdgeObservation(points, np.full(points.shape[:3], 0.01))


def test_perspective_is_seen_from_four_states_on_if_it_exceeds_its_scatter() -> None:
    centre = np.array([20.0, 5.0])
    seen = seen_depth(edges_of_a_beam(5, 200.0), centre, 6.0)
    assert seen is not None
    assert seen.stand_off_mm == pytest.approx(200.0, rel=0.1)
    assert seen.change_mm > 0.05
    assert seen_depth(edges_of_a_beam(4, 200.0), centre, 6.0) is not None
    assert seen_depth(edges_of_a_beam(3, 200.0), centre, 6.0) is None
    assert seen_depth(edges_of_a_beam(5, -200.0), centre, 6.0) is None  # the beam looks narrower away from the centre
    assert seen_depth(edges_of_a_beam(5, 1e9, 0.01), centre, 6.0) is None


def test_arc_lengths_follow_the_smoothed_edge_from_the_clamp() -> None:
    straight = np.stack([np.linspace(0.5, 30.0, 60), np.full(60, 2.0)], axis=1)
    assert _along_mm(straight) == pytest.approx(straight[:, 0])
    zigzag = straight + np.array([[0.0, 0.05], [0.0, -0.05]] * 30)
    assert _along_mm(zigzag)[-1] == pytest.approx(30.0, rel=2e-3)  # and not the length of the zigzag
    turn = np.linspace(0.0, 0.5 * np.pi, 200)
    arc = 20.0 * np.stack([np.sin(turn), 1 - np.cos(turn)], axis=1)
    assert _along_mm(arc) == pytest.approx(20.0 * turn, abs=0.02)
    assert _along_mm(np.zeros((0, 2))).shape == (0,)
    assert _along_mm(straight[:2]).tolist() == straight[:2, 0].tolist()
    rest = np.array([[[3.0, 1.0], [9.0, 0.0]]])
    tracked = PointObservation(rest, rest + 1.0, np.ones((1, 2)))
    assert _arc_length_mm(tracked).tolist() == [[[3.0, 9.0], [3.0, 9.0]]]


def test_residuals_have_one_error_for_each_state() -> None:
    distance = np.array([[[3e-3, 4e-3], [0.0, np.nan]]])
    edges = Residuals("run.h5", np.array([2]), np.array([5.0]), ("left", "right"), 0 * distance, distance)
    assert edges.root_mean_square_mm == pytest.approx([np.sqrt(25e-6 / 3)])
    assert repr(edges) == "<Residuals of run.h5: 1 states, 3 points>"
    tracked = replace(edges, edge=("x", "y"), distance_mm=np.array([[[3e-3, np.nan], [4e-3, np.nan]]]))
    assert tracked.root_mean_square_mm == pytest.approx([5e-3])
    assert repr(tracked) == "<Residuals of run.h5: 1 states, 1 points>"
    assert "<td>2</td><td>5.000</td><td>5</td>" in tracked._repr_html_().replace("\n", "").replace(" ", "")


@pytest.mark.parametrize(
    ("width_mm", "depth_mm", "words"),
    [
        (4.79, 10.0, None),
        (4.81, 10.0, "correct width_mm"),
        (3.34, 10.0, None),
        (3.32, 10.0, "or correct pixels_per_mm"),
        (6.0, 5.65, "correct width_mm"),
        (6.0, 5.67, "exchange width_mm and depth_mm"),
        (None, 10.0, None),
    ],
)
def test_a_width_in_the_picture_that_differs_by_a_fifth_is_refused(
    monkeypatch: pytest.MonkeyPatch, width_mm: float | None, depth_mm: float, words: str | None
) -> None:
    monkeypatch.setattr("eimi_lab.vision.intensity.grey", lambda picture: None)
    monkeypatch.setattr("eimi_lab.vision.intensity.state_mean", lambda frames: None)
    monkeypatch.setattr("eimi_lab.vision.edges.apparent_width.apparent_width_mm", lambda *given: width_mm)
    monkeypatch.setattr(before_search, "BeamFrame", lambda calibration: None)
    beam = SimpleNamespace(width_mm=4.0, depth_mm=depth_mm, length_mm=40.0)
    one: Any = SimpleNamespace(
        specimen=SimpleNamespace(specimen=beam), calibration=SimpleNamespace(pixels_per_mm=25.0), path=Path("run.h5"),
        each_image=lambda number: None,
    )  # fmt: skip
    if words is None:
        before_search.check_width(one)
    else:
        with pytest.raises(InputError, match=words):
            before_search.check_width(one)
    one.calibration = None
    before_search.check_width(one)


def state(current_A: float | None = None, field_mT: float = 0.0) -> State:
    return State(0, current_A, None, field_mT, 0.0, ())


@pytest.mark.parametrize(
    ("current_A", "field_mT", "is_refused"),
    [(101.0, 501.0, True), (-101.0, -501.0, True), (99.0, 501.0, False), (101.0, 499.0, False), (None, 501.0, False)],
)
def test_a_current_and_a_field_that_no_coil_makes_are_refused(
    current_A: float | None, field_mT: float, is_refused: bool
) -> None:
    states = [state(0.0), state(current_A, field_mT)]
    if is_refused:
        with pytest.raises(InputError, match="which is too strong for a coil; current_A should be in ampere"):
            before_search._check_currents(states)
    else:
        before_search._check_currents(states)


@pytest.mark.parametrize(("moved_mm", "is_refused"), [(0.39, False), (0.41, True)])
def test_a_tip_that_moves_by_a_hundredth_of_the_length_in_a_field_is_magnetic(
    moved_mm: float, is_refused: bool
) -> None:
    rest = np.array([[[20.0, 0.0], [40.0, 0.0]]] * 2)
    moved = rest.copy()
    moved[1, :, 1] += moved_mm
    observed = PointObservation(rest, moved, np.ones((2, 2)))
    specimen = Specimen(40.0, 4.0, 4.0, 1070.0)
    experiment: Any = SimpleNamespace(
        model=SimpleNamespace(specimen=specimen), loads=Loads.along([0.0, 5.0]), observed=observed
    )
    if is_refused:
        with pytest.raises(InputError, match=r"the tip moves by 0\.41 mm in fields of up to 5 mT.* import again"):
            before_search._check_magnet(Path("run.h5"), experiment)
    else:
        before_search._check_magnet(Path("run.h5"), experiment)
    for loads in (Loads.along([5.0, 5.0]), Loads.along([0.0, 5.0], tip_force_N=[0.0, 0.1])):
        experiment.loads = loads  # the field is constant, or a force may have moved the tip
        before_search._check_magnet(Path("run.h5"), experiment)
    experiment.loads = Loads.along([0.0, 5.0])
    experiment.model.specimen = replace(specimen, magnetisation_A_per_m=(0.0, 1e3))
    before_search._check_magnet(Path("run.h5"), experiment)


def test_the_tip_of_an_edge_is_its_last_measured_point_and_that_of_points_is_their_mean() -> None:
    points = np.zeros((1, 2, 3, 2))
    points[0, :, :, 0] = [10.0, 20.0, 30.0]
    points[0, 1, :, 1] = 4.0
    sigma = np.array([[[0.1, 0.1, np.inf], [0.1, 0.1, 0.1]]])
    edges: Any = SimpleNamespace(observed=EdgeObservation(points, sigma))
    assert before_search._tips_mm(edges).tolist() == [[25.0, 2.0]]
    rest = np.zeros((2, 2, 2))
    tracked: Any = SimpleNamespace(
        observed=PointObservation(
            rest, rest + np.array([[[1.0, 2.0]], [[3.0, 5.0]]]), np.array([[1.0, np.inf], [1.0, 1.0]])
        )
    )
    assert before_search._tips_mm(tracked).tolist() == [[1.0, 2.0], [3.0, 5.0]]


def test_a_tip_outside_the_measured_map_of_the_field_is_refused() -> None:
    points = np.zeros((1, 2, 2, 2))
    points[0, :, 1, 0] = 30.0
    table = SimpleNamespace(covers=lambda at: bool(at[0, 0] <= limit["x"]), x_mm=[0.0, 29.0], y_mm=[-5.0, 5.0])
    experiment: Any = SimpleNamespace(
        observed=EdgeObservation(points, np.ones((1, 2, 2))), loads=SimpleNamespace(coil=SimpleNamespace(table=table))
    )
    limit = {"x": 30.0}
    before_search._check_map(experiment)
    limit["x"] = 29.0
    with pytest.raises(
        InputError, match=r"the tip reaches x_mm = 30, y_mm = 0, but .* from 0 to 29 and y_mm from -5 to 5"
    ):
        before_search._check_map(experiment)
    experiment.loads.coil = None
    before_search._check_map(experiment)


def test_forty_replicates_give_an_interval() -> None:
    def interval(count: int) -> tuple[float, float] | None:
        given = [
            ReplicateRecord(replicate=k, parameters={}, initial_shear_modulus_Pa=float(k), mean_error_mm=0.0,
                            evaluations=1, stop="", wall_s=0.0)
            for k in range(count)
        ]  # fmt: skip
        found = BootstrapRecord.of(given)
        assert len(found.replicates) == count
        return found.initial_shear_modulus_interval_95_Pa

    assert interval(39) is None
    assert interval(41) == pytest.approx((1.0, 39.0))
    assert interval(40) is not None


def test_a_replayed_generation_may_differ_by_rounding_errors_only() -> None:
    one = checkpoint.Generation(run=1, best_mm=1.0, mean_mm=2.0, step_size=0.1, axis_ratio=1.0, discarded=0)
    assert checkpoint._same(replace(one, best_mm=1.0 + 0.9e-6), one)
    assert not checkpoint._same(replace(one, mean_mm=2.0 * (1 + 1.2e-6)), one)
    assert not checkpoint._same(replace(one, discarded=1), one)
    assert checkpoint._words("a") == "a"
    assert checkpoint._words(("a", "b", "c", "d")) == "a, b, c, d"
    assert checkpoint._words(("a", "b", "c", "d", "e", "f")) == "a, b, c, d and 2 more"
    assert checkpoint._pairs("x ", {"a": 1, "b": 2}, {"b": 3, "c": 4}) == [
        ("x a", 1, None), ("x b", 2, 3), ("x c", None, 4)
    ]  # fmt: skip


def tensile(**more: Any) -> Any:
    given = {"rows_left_out": 0, "rmse_Pa": 9.9, "initial_shear_modulus_interval_Pa": (1.0, 2.0), "stable_to": None,
             "max_stretch": 1.5}  # fmt: skip
    return SimpleNamespace(**(given | more))


def test_a_tensile_fit_is_doubted_by_its_residuals_its_interval_and_its_stability() -> None:
    def kinds(**more: Any) -> list[str | None]:
        return [doubt.kind for doubt in tensile_fits._doubts(tensile(**more), 100.0)]

    assert kinds() == []
    assert kinds(rmse_Pa=10.1) == ["curve_shape"]
    assert kinds(rows_left_out=1) == ["rows_left_out"]
    assert kinds(initial_shear_modulus_interval_Pa=(0.0, 2.0)) == ["modulus_open"]
    assert kinds(initial_shear_modulus_interval_Pa=(-1.0, 2.0)) == ["modulus_open"]
    assert kinds(stable_to=1.49) == ["unstable"]
    assert kinds(stable_to=1.5) == kinds(stable_to=1.51) == []


@pytest.mark.parametrize(
    ("columns", "rows", "words"),
    [
        ("strain,stress_kPa", "0.1,1\n15.1,2", "name it strain_percent"),
        ("strain,stress_kPa", "0.1,1\n14.9,2", None),
        ("strain_percent,stress_kPa", "10,1\n1500,2", None),
        ("strain_percent,stress_kPa", "10,1\n10001,2", r"above -1 \(-100 %\) and at most 100"),
        ("strain_percent,stress_kPa", "10,1\n9999,2", None),
        ("strain,stress_kPa", "-1,1\n0.1,2", r"above -1 \(-100 %\)"),
        ("strain,stress_kPa", "-0.99,1\n0.1,2", None),
        ("strain,stress_Pa", "0.1,1.1e12", r"a stress of at most 1e\+12 Pa"),
        ("strain,stress_Pa", "0.1,-1.1e12", r"a stress of at most 1e\+12 Pa"),
        ("strain,stress_Pa", "0.1,0.9e12", None),
    ],
)
def test_strains_and_stresses_beyond_any_material_are_refused(
    tmp_path: Path, columns: str, rows: str, words: str | None
) -> None:
    path = tmp_path / "test.csv"
    path.write_text(f"{columns}\n{rows}\n", encoding="utf-8")
    if words is None:
        found = tensile_files.read_tensile(path)
        factor = tensile_files.STRAINS[columns.partition(",")[0]]
        assert found.strain[0] == pytest.approx(float(rows.partition(",")[0]) * factor)
    else:
        with pytest.raises(InputError, match=words):
            tensile_files.read_tensile(path)


def test_a_curve_needs_five_rows_in_its_window(tmp_path: Path) -> None:
    path = tmp_path / "test.csv"
    path.write_text("strain,stress_MPa\n" + "".join(f"{0.1 * k},{0.01 * k}\n" for k in range(1, 8)), encoding="utf-8")
    curve = tensile_files.read_curve(path, 50.0, 2.0)
    assert curve.strain == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5])
    assert curve.stress_Pa == pytest.approx([1e4, 2e4, 3e4, 4e4, 5e4])
    assert (curve.weight, curve.window_percent, curve.path) == (2.0, 50.0, str(path))
    assert len(tensile_files.read_curve(path, None, 1.0).strain) == 7
    with pytest.raises(InputError, match="4 rows up to the largest strain to fit; a fit needs at least 5"):
        tensile_files.read_curve(path, 49.0, 1.0)


def test_windows_are_strains_above_zero_without_repetitions() -> None:
    assert tensile_files.check_windows(["20", "full", "20.0", "50"]) == [20.0, None, 50.0]
    for wrong in ("0", "-5", "inf", "much"):
        with pytest.raises(InputError, match=f"--window {wrong}: should be a strain in percent above 0, or full"):
            tensile_files.check_windows([wrong])


def test_flagged_and_widened_states_are_told() -> None:
    used = StatesUsed(
        5,
        (FlaggedState(0, ("BLUR",)), FlaggedState(3, ("BLUR", "SHADOW"))),
        (FlaggedState(1, ("GLARE",)),),
        (WidenedState(1, 0.01), WidenedState(2, 0.025)),
    )
    assert used.in_words() == (
        "3 of 5 states used; left out: BLUR in 2 (states 0, 3), SHADOW in 1 (state 3); used although they have flags: "
        "GLARE in 1 (state 1); the uncertainty of the points was increased in 2 states (the largest increase is "
        "0.025 mm in state 2)"
    )
    assert StatesUsed(2, (), (), (WidenedState(1, 0.5),)).in_words() == (
        "2 of 2 states used; the uncertainty of the points was increased in 1 state (the largest increase is 0.5 mm in "
        "state 1)"
    )


def test_draws_are_taken_evenly() -> None:
    draws = np.arange(10.0)
    assert LawRecord._evenly(draws, 4).tolist() == [1.0, 3.0, 6.0, 8.0]
    assert LawRecord._evenly(draws, 10) is draws
    assert LawRecord._evenly(draws, None) is draws
    assert LawRecord._evenly(draws, 9).tolist() == [0.0, 1.0, 2.0, 3.0, 5.0, 6.0, 7.0, 8.0, 9.0]


def budgeted(*effects: float) -> Any:
    entries = [
        SimpleNamespace(words=f"input {k}", effect_percent=effect, standard_uncertainty=0.01 * (k + 1),
                        unit="1" if k % 2 else "mm", datasets=(0,))
        for k, effect in enumerate(effects)
    ]  # fmt: skip
    modulus = Quantity(50e3, "Pa", (48e3, 52e3), (49e3, 51e3))
    after = SimpleNamespace(source="width", words="width", initial_shear_modulus_interval_95_Pa=(48.5e3, 51.5e3))
    return SimpleNamespace(budget=tuple(entries), initial_shear_modulus=modulus, measure_next=after,
                           taken_as_exact=("dimensions", "length"),
                           datasets=(SimpleNamespace(path="a.h5"),))  # fmt: skip


def test_the_five_largest_sources_have_a_line_and_the_others_one_together() -> None:
    lines = fit_summary.budget_lines(budgeted(6.0, 5.0, 4.0, 3.0, 2.0, 0.3, 0.4))
    assert lines[0] == "input 0 ± 0.01 mm: ± 6 % of the modulus"
    assert lines[1] == "input 1 ± 2 %: ± 5 % of the modulus"
    assert lines[5:] == [
        "2 smaller sources together: ± 0.5 % of the modulus",
        "all 7 sources together: ± 9.5 % of the modulus (standard uncertainty; the 95 % interval is ± twice this "
        "value)",
        "95 % interval from noise and mesh error alone: [49000, 51000] Pa",
        "taken as exact, because no uncertainty is given: length",
        "Measure better next: width. With half of this uncertainty the interval would be [48500, 51500] Pa.",
    ]
    one = fit_summary.budget_lines(budgeted(6.0))
    assert len(one) == 4
    assert not any("together" in line for line in one)
    nothing = budgeted()
    assert fit_summary.budget_lines(nothing) == ["taken as exact, because no uncertainty is given: length"]
    nothing.measure_next.source = None
    assert fit_summary.next_sentence(nothing) == (
        "Noise and mesh limit this interval. With about four times as many states the interval would be [48500, 51500] "
        "Pa."
    )
    entry = SimpleNamespace(words="width", datasets=(1,))
    two: Any = SimpleNamespace(datasets=(SimpleNamespace(path="a.h5"), SimpleNamespace(path="b.h5")))
    assert fit_summary.entry_words(entry, two) == "width of b.h5"  # type: ignore[arg-type]
    assert fit_summary.signed(0.0123, "1") == "+1.2 %"
    assert fit_summary.signed(-0.0123, "mm") == "-0.012 mm"


def test_laws_are_compared_in_a_table() -> None:
    def choice(model: str, aicc: float | None, weight: float | None, left_out: float | None) -> Choice:
        return Choice(model, 2, 12.25, aicc, 3.5, weight, left_out)

    table = fit_summary.comparison_table([choice("yeoh", 1.5, 0.25, 0.0123), choice("ogden", None, None, None)])
    assert table[1] == "yeoh                    2     1.5     3.5    0.250   12.30 µm"
    assert table[2] == "ogden                   2 too few     3.5        -   -"
    assert table[3].startswith("AICc and BIC count the data as 12.2 independent points")
    assert table[4].endswith("counts as an unknown; the weights compare only the other laws.")
    assert "too few for an AICc of ogden." in table[4]
    alone = fit_summary.too_few_in_words([choice("ogden", None, None, None)])
    assert alone[0].endswith("; there are no weights.")
    assert fit_summary.too_few_in_words([choice("yeoh", 1.5, None, None)]) == []
    assert fit_summary.comparison_table([]) == []


def test_probable_causes_are_told_in_one_line() -> None:
    def cause(name: str, value: float, unit: str, within: bool, probability: float) -> Any:
        return SimpleNamespace(name=name, value=value, unit=unit, is_within_stated=within, shift_percent=-1.234,
                               probability=probability)  # fmt: skip

    fit: Any = SimpleNamespace(causes=[
        cause("scale", 0.02, "1", True, 0.9), cause("none", 0.0, "", False, 0.08),
        cause("roll", 1.0, "deg", False, 0.01),
    ])  # fmt: skip
    assert fit_summary.cause_lines(fit) == [
        "causes of the residuals: scale +2.0 % (within the stated uncertainty, changes the modulus by -1.2 %), "
        "probability 0.9; no listed cause, probability 0.08"
    ]
    assert fit_summary.cause_lines(SimpleNamespace(causes=[])) == []  # type: ignore[arg-type]


def test_lengths_and_kinds_of_fits_are_written_in_words() -> None:
    lengths = [validation_tables.micrometres(mm) for mm in (None, 9.994e-3, 0.01, 0.09994, 0.1, 1.0)]
    assert lengths == ["-", "9.99", "10.0", "99.9", "100", "1000"]
    one: Any = SimpleNamespace(mean_error_mm=0.012, mean_error_interval_mm=(0.011, None), status="ok")
    assert validation_tables.error_in_words(one) == "12.0 [11.0, >]"
    one.mean_error_interval_mm = (0.011, 0.1)
    assert validation_tables.error_in_words(one) == "12.0 [11.0, 100]"
    one.mean_error_interval_mm = None
    assert validation_tables.error_in_words(one) == "12.0"
    one.mean_error_mm, one.status = None, "no equilibrium"
    assert validation_tables.error_in_words(one) == "no equilibrium"
    for kind, window, words in (("bending", None, "bending"), ("tensile", None, "tensile full"),
                                ("tensile", 50.0, "tensile 50 %")):  # fmt: skip
        reference = FitReference(path="fits.json", index=0, kind=kind, window_percent=window)  # type: ignore[arg-type]
        assert reference.kind_in_words() == words
    cells, head = ("a", "1"), ("law", "error")
    assert validation_tables._line(cells, [5, 6], head, ("error",)) == "  a           1"


def evidence(ratio: float = 0.5, section: str = "plane-stress") -> Any:
    specimen = Specimen(40.0, 4.0, 4.0, 1070.0, section)  # type: ignore[arg-type]
    return SimpleNamespace(
        path="run.h5", poisson_ratio=ratio, experiment=SimpleNamespace(model=SimpleNamespace(specimen=specimen))
    )


def test_a_compressible_material_is_remarked_below_a_ratio_of_0_495(monkeypatch: pytest.MonkeyPatch) -> None:
    assert assumptions.compressibility_remark(evidence(0.495)) is None
    found = assumptions.compressibility_remark(evidence(0.49))
    assert found == (
        "run.h5: poisson_ratio = 0.49 means a bulk modulus of 49.7 shear moduli; the fit takes the material as "
        "incompressible, and its modulus is therefore about 0.7 % too low"
    )
    for bias, words in ((0.03, "about 3 % too high"), (-0.02, "about 2 % too low")):
        monkeypatch.setattr(assumptions, "expected_bias", lambda specimen, bias=bias: bias)
        assert words in assumptions.section_remark(evidence())  # type: ignore[operator]
    assert assumptions.section_remark(evidence(section="solid")) is None


def ring_down(
    frequencies_Hz: tuple[float, float], effects: dict[str, float], static_percent: float, **sources: float
) -> Any:
    # Return the result of `expected_ring_down` for a stand-in of the beam.
    # `frequencies_Hz`: its frequencies with the modulus of the law and with a modulus 5 % larger.
    answers = iter([*frequencies_Hz, *(frequencies_Hz[0] * np.exp(0.01) for _ in sources)])

    class Beam:
        def __init__(self, *given: Any) -> None:
            pass

        def undamped_Hz(self, modulus: float) -> np.ndarray:
            return np.array([next(answers)])

        def under(self, deviations: Any) -> Beam:
            return self

    stated = [StatedSource(key, sigma, "file") for key, sigma in sources.items()]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planned_ring_down, "RingingBeam", Beam)
        patch.setattr(planned_ring_down, "small_effects", lambda *given: [SimpleNamespace(modulus_percent=0.12)])
        return planned_ring_down.expected_ring_down(
            KnownLaw(LAWS["neo-hookean"], np.array([20e3])), Specimen(40.0, 4.0, 4.0, 1070.0), 0.0, 0.0, stated,
            static_percent, effects,
        )  # fmt: skip


def test_a_ring_down_joins_the_static_states_by_generalised_least_squares() -> None:
    gain = 2.0
    stiffer_Hz = 10.0 * 1.05 ** (1 / gain)
    found = ring_down((10.0, stiffer_Hz), {"width": 1.5, "moment": 2.0}, 6.0, width=0.05)
    noise = np.hypot(100 * gain * 5e-4, 0.12)
    by_width = 100 * gain * 0.01
    assert found.frequency_Hz == 10.0
    assert found.dynamic_percent == pytest.approx(NORMAL_95 * np.hypot(by_width, noise))
    static = (6.0 / NORMAL_95) ** 2
    covariance = np.array([[static, 1.5 * by_width], [1.5 * by_width, by_width**2 + noise**2 + 1.0]])
    joined = 1 / np.linalg.inv(covariance).sum()
    assert found.with_percent == pytest.approx(NORMAL_95 * np.sqrt(joined))
    assert found.without_percent == 6.0
    assert found.moment_share_percent == pytest.approx(NORMAL_95 * 2.0)
    difference = (1.5 - by_width) ** 2 + static - 1.5**2 - 4.0 + noise**2 + 1.0
    assert found.moment_percent == pytest.approx(NORMAL_95 * np.sqrt(1 / (1 / 4.0 + 1 / difference)))
    assert "would shrink from ± 3.92 % to" in found.in_words
    without = ring_down((10.0, stiffer_Hz), {"width": 1.5}, 6.0, width=0.0)
    assert without.moment_percent is None
    assert without.dynamic_percent == pytest.approx(NORMAL_95 * noise)
    assert "would shrink" not in without.in_words


def criterion(states: list[int]) -> Candidates:
    count = len(states)
    numbers = np.arange(1.0, 1 + count)
    return Candidates(
        loads=Loads.along(np.arange(float(count))), states=np.array(states), normal=numbers[:, None, None],
        source_score=10 * numbers[:, None, None], sources=("width",), prior=np.eye(1), goal=np.ones(1), points=7.0,
        irreducible=0.1,
    )  # fmt: skip


def test_states_at_opposite_currents_are_chosen_as_pairs() -> None:
    pairs = planning._in_pairs(criterion([0, 2, 3, 4, 5, 6]), 4)  # currents 0 to 3, and 4 to 7 for the opposite ones
    assert isinstance(pairs, Candidates)
    assert pairs.states.tolist() == [0, 2]
    assert pairs.normal[:, 0, 0].tolist() == [1.0 + 4.0, 2.0 + 6.0]
    assert pairs.source_score[:, 0, 0].tolist() == [50.0, 80.0]
    assert pairs.points == 14.0
    assert len(pairs.loads) == 2
    with pytest.raises(ValueError, match="at both signs of the current for 1 currents; at least 2 are needed"):
        planning._in_pairs(criterion([0, 1, 4]), 4)
    numbers = np.arange(1.0, 5.0)
    rival = Rivals(
        Loads.along(numbers), np.array([0, 1, 4, 5]), numbers, numbers[:, None], numbers[:, None, None], np.eye(1)
    )
    both = planning._in_pairs(rival, 4)
    assert isinstance(both, Rivals)
    assert (both.square.tolist(), both.score[:, 0].tolist()) == ([4.0, 6.0], [4.0, 6.0])
    assert both.normal[:, 0, 0].tolist() == [4.0, 6.0]


def test_a_plan_chooses_among_41_currents_of_the_stricter_limit() -> None:
    def currents(driver: str, simulated: bool = False) -> np.ndarray:
        limits = SimpleNamespace(stricter=lambda other: SimpleNamespace(current_A=2.0))
        supply = SimpleNamespace(driver=driver, limits=None)
        rig: Any = SimpleNamespace(simulated=simulated, supply=supply, current_step_A=None)
        return planning._currents(rig, SimpleNamespace(limits=limits))  # type: ignore[arg-type]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planning, "is_bipolar", lambda driver: driver == "both")
        assert currents("one") == pytest.approx(np.linspace(0.0, 2.0, 41))
        assert currents("both") == pytest.approx(np.linspace(-2.0, 2.0, 41))
        assert currents("both", simulated=True)[0] == 0.0


def test_a_mounting_and_a_goal_are_described() -> None:
    specimen: Any = SimpleNamespace(specimen=SimpleNamespace(name="type1"))
    mounting = planning.Mounting(specimen, 90.0, 5.0, both_polarities=True)
    assert mounting.tip_force_N == pytest.approx(5e-3 * 9.80665)
    assert mounting.in_words() == "type1, gravity at 90°, 5 g at the tip, both polarities"
    assert planning.Mounting(specimen, None, 0.0).in_words() == "type1, no gravity"
    fit: Any = SimpleNamespace(model="yeoh")
    assert planning.Goal(fit).value(1.2345) == "± 1.23 %"
    assert planning.Goal(fit, rival=fit).value(12.345) == "12.3"
    assert planning.Goal(fit).in_words() == "initial shear modulus of yeoh, expected half-width of the 95 % interval"


def test_the_lines_of_a_viscoelastic_law_name_its_terms_its_moment_and_five_sources() -> None:
    quantity = Quantity(50e3, "Pa", (48e3, 52e3))
    ring = SimpleNamespace(label="", frequency_Hz=5.5, frequency_sigma_Hz=0.001, decay_loss=0.1, decay_loss_sigma=0.002,
                           amplitude_mm=2.5)  # fmt: skip
    entries = [
        SimpleNamespace(words=f"input {k}", effect_percent=effect) for k, effect in enumerate((4, 3, 2, 0, 0.5, 1))
    ]
    time: Any = SimpleNamespace(
        dynamic_shear_modulus=quantity, prony=[SimpleNamespace(g=0.1, tau_s=2.0)], known_between_s=(0.01, 30.0),
        frequency_Hz=5.5, loss_factor=0.1, loss_interval_95=(0.09, 0.11), ring_downs=[ring],
        instantaneous_shear_modulus=quantity, long_term_shear_modulus=quantity,
        moment=Quantity(1.02, "1", (0.99, 1.05)), static_age_s=12.0, budget=entries, doubts=("the hand touched it",),
    )  # fmt: skip
    lines = time_records.time_lines(time)
    assert lines[1] == (
        "ring-down: 5.5000 ± 0.001 Hz, loss factor of the decay 0.1000 ± 0.002, from an amplitude of 2.5 mm"
    )
    assert lines[2] == "Prony series of 1 term: g = 0.1 with tau = 2 s"
    assert lines[6] == (
        "magnetic moment from static states and ring-downs together (static states: measured 12 s after the load was "
        "set, as a median): 1.020 [0.990, 1.050] times the given moment"
    )
    assert lines[7:] == [
        *(
            f"source of uncertainty input {k}: ± {e} % of the dynamic modulus"
            for k, e in ((0, 4), (1, 3), (2, 2), (4, 0.5))
        ),
        "doubt: the hand touched it",
    ]
    time.static_age_s, time.known_between_s = None, None
    assert "together: 1.020" in time_records.time_lines(time)[6]
    assert time_records.time_lines(time)[5] == (
        "the data determine the shear modulus at no time with an error of at most 5 %"
    )
