"""The inputs of a fit and its stored results have the right values; datasets and searches are stand-ins."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_fitting import LAWS, Loads
from eimi_fitting.inference.doubts.checks import Doubt
from eimi_fitting.inference.evidence.measurements import EdgeObservation, PointObservation
from eimi_fitting.inference.evidence.quantity import Quantity
from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_fitting.inference.interval.draws import Draws
from eimi_fitting.inference.searching.named_causes import NamedCause, Slip
from eimi_lab.fits import (
    assumptions,
    before_search,
    evidence,
    fits_file,
    fitting,
    measured_conditions,
    measured_remarks,
    predicted_error,
    recorded_motions,
    records,
    simulated_fit,
)
from eimi_lab.fits.law_record import LawRecord, Stability
from eimi_lab.fits.perspective import SeenDepth
from eimi_lab.fits.records import FitRecord, StateError
from eimi_lab.fits.residuals import Residuals
from eimi_lab.process.errors import InputError

EDGES = EdgeObservation(np.zeros((2, 2, 3, 2)), np.ones((2, 2, 3)))
POINTS = PointObservation(np.zeros((2, 3, 2)), np.zeros((2, 3, 2)), np.ones((2, 3)), np.zeros((2, 3)))


def calibration(**more: Any) -> Any:
    given: dict[str, Any] = {"telecentric": False, "mT_per_A": 4.7, "coil_constant_mT_per_A": 4.7, "uncertainty": None}
    changed: list[Any] = []
    made = SimpleNamespace(
        **{**given, **more},
        changed=changed,
        stated_sources=lambda: (StatedSource("coil", 0.01, "coil"), StatedSource("scale", 0.003, "scale")),
        uncertain_keys=lambda: ("coil_constant_mT_per_A", "pixels_per_mm"),
    )
    made.model_copy = lambda update: changed.append(update) or made
    return made


def dataset(of: Any = None, **more: Any) -> Any:
    beam = SimpleNamespace(depth_mm=5.0, width_mm=3.0, rest_shape="measured")
    specimen = SimpleNamespace(
        specimen=beam,
        uncertainty=None,
        uncertain_keys=lambda: ("width_mm",),
        stated_sources=lambda: (StatedSource("width", 0.02, "specimen"),),
        mechanics=lambda: "beam",
    )
    given: dict[str, Any] = {
        "path": Path("run.h5"),
        "calibration": of,
        "specimen": specimen,
        "frame_format": lambda: ((480, 640, 3), "uint8"),
        "states": (),
        "text": lambda name: None,
        "field_line": None,
        "gravity": True,
        "gravity_angle_deg": 20.0,
        "field_angle_deg": 80.0,
        **more,
    }
    return SimpleNamespace(**given)


class Frame:
    # A stand-in for the frame of a beam, which keeps what was asked of it.

    asked: list[Any]

    def __init__(self, of: Any) -> None:
        self.of = of

    def view(self, depth_mm: float, size: tuple[int, int]) -> Any:
        type(self).asked.append((depth_mm, size))
        if depth_mm > 50:
            raise ValueError("too near")
        return SimpleNamespace(centre_mm="middle")


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    Frame.asked = []
    monkeypatch.setattr(evidence, "BeamFrame", Frame)
    return Frame.asked


def test_the_view_of_the_lens_has_the_depth_of_the_beam_and_the_size_of_the_picture(asked: list[Any]) -> None:
    assert evidence._view(dataset()) is None
    one: Any = evidence._view(dataset(calibration()))
    assert one.centre_mm == "middle"
    assert asked == [(5.0, (640, 480))]
    deep = dataset(calibration())
    deep.specimen.specimen.depth_mm = 51.0
    with pytest.raises(InputError, match=r"run\.h5: calibration\.stand_off_mm: too near"):
        evidence._view(deep)


@pytest.mark.parametrize(("telecentric", "stated"), [(True, "telecentric = true"), (False, "no stand_off_mm")])
def test_perspective_in_the_edges_contradicts_a_calibration_without_a_distance(
    telecentric: bool, stated: str, asked: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[Any] = []
    found = SeenDepth(147.0, 0.1234)
    monkeypatch.setattr(evidence, "seen_depth", lambda *given: seen.append(given) or found)
    of = calibration(telecentric=telecentric)
    (doubt,) = evidence._lens_doubts(dataset(of), EDGES)
    assert doubt.startswith("the beam appears up to 0.12 mm wider away from the middle of the picture")
    assert f"about 150 mm away, but the calibration has {stated}: measure stand_off_mm" in doubt
    assert of.changed == [{"telecentric": False, "stand_off_mm": 5e3}]
    assert seen == [(EDGES, "middle", 5.0)]
    assert asked == [(5.0, (640, 480))]
    assert evidence._lens_doubts(dataset(), EDGES) == ()
    assert evidence._lens_doubts(dataset(of), POINTS) == ()
    view: Any = "view"
    assert evidence._lens_doubts(dataset(of), replace(EDGES, view=view)) == ()
    monkeypatch.setattr(evidence, "seen_depth", lambda *given: None)
    assert evidence._lens_doubts(dataset(of), EDGES) == ()


def test_the_loads_of_states_have_their_fields_forces_and_directions(monkeypatch: pytest.MonkeyPatch) -> None:
    states: Any = [
        SimpleNamespace(field_mT=3.0, tip_force_N=0.01, tip_force_angle_deg=None),
        SimpleNamespace(field_mT=5.0, tip_force_N=0.02, tip_force_angle_deg=75.0),
    ]
    plain = evidence.loads_of_states(dataset(), states)
    expected = Loads.along([3.0, 5.0], 80.0, 20.0, [0.01, 0.02], tip_force_angle_deg=[20.0, 75.0])
    for name in ("field_T", "gravity", "tip_force_N"):
        assert getattr(plain, name) == pytest.approx(getattr(expected, name))
    assert not evidence.loads_of_states(dataset(gravity=False), states).gravity.any()
    calls: list[Any] = []
    monkeypatch.setattr(evidence, "in_stated_field", lambda *given: calls.append(given[1:]) or "in field")
    monkeypatch.setattr(evidence, "with_measured_offset", lambda loads, data: (loads, data.path))
    of = calibration()
    assert evidence.loads_of_states(dataset(of), states) == ("in field", Path("run.h5"))  # type: ignore[comparison-overlap]
    assert calls == [(of, "beam")]

    def refuse(*given: Any) -> Any:
        raise InputError("no map")

    monkeypatch.setattr(evidence, "in_stated_field", refuse)
    with pytest.raises(InputError, match=r"^run\.h5: no map$"):
        evidence.loads_of_states(dataset(of), states)


def test_measured_fields_replace_the_uncertainty_of_the_coil(monkeypatch: pytest.MonkeyPatch) -> None:
    def names(sources: Any) -> list[str]:
        return [source.source for source in sources]

    measured: list[StatedSource] = []
    asked: list[Any] = []
    monkeypatch.setattr(evidence, "stated_by_measurement", lambda data, states: tuple(measured))
    rig = StatedSource("offset", 0.1, "rig")
    monkeypatch.setattr(evidence, "stated_by_rig", lambda *given: asked.append(given) or (rig,))
    assert names(evidence.sources_of(dataset())) == ["width"]
    assert names(evidence.sources_of(dataset(calibration()))) == ["width", "coil", "scale"]
    with_rig = dataset(calibration(), text=lambda name: f"text of {name}")
    assert names(evidence.sources_of(with_rig)) == ["width", "coil", "scale", "offset"]
    assert asked == [("text of rig", "run.h5: rig", 4.7)]
    keys: list[Any] = []
    monkeypatch.setattr(evidence, "missing_keys", lambda *given: keys.append(given) or (given[0],))
    assert evidence.taken_as_exact(dataset()) == ("dimensions",)
    assert evidence.taken_as_exact(dataset(calibration())) == ("dimensions", "calibration")
    measured.append(StatedSource("coil", 0.02, "probe"))
    assert names(evidence.sources_of(with_rig)) == ["width", "scale", "coil"]
    assert evidence.sources_of(with_rig)[-1].standard_uncertainty == 0.02
    evidence.taken_as_exact(dataset(calibration()))
    assert keys[0] == ("dimensions", None, ("width_mm",))
    assert keys[2] == ("calibration", None, ["coil_constant_mT_per_A", "pixels_per_mm"])
    assert keys[-1] == ("calibration", None, ["pixels_per_mm"])


def test_a_measured_offset_is_a_background_field_along_the_axis_of_the_coil(monkeypatch: pytest.MonkeyPatch) -> None:
    loads = Loads.along([1.0, 2.0])
    monkeypatch.setattr(measured_conditions, "stated_background_T", lambda of: np.array([2e-5, 5e-5]))
    line = SimpleNamespace(offset_mT=0.3)
    for data in (dataset(calibration()), dataset(field_line=line)):
        assert measured_conditions.with_measured_offset(loads, data) is loads
    found = measured_conditions.with_measured_offset(loads, dataset(calibration(), field_line=line))
    axis = np.array([np.cos(np.radians(80.0)), np.sin(np.radians(80.0))])
    more_T = 3e-4 - (2e-5 * axis[0] + 5e-5 * axis[1])
    (field,) = found.others
    assert field.numbers == pytest.approx(np.tile(more_T * axis, (2, 1)))


def test_the_figure_and_the_table_of_the_evidence(monkeypatch: pytest.MonkeyPatch) -> None:
    from eimi_lab.dataset import plotting

    drawn: list[Any] = []
    monkeypatch.setattr(plotting, "drawn_places", lambda *given, **options: drawn.append((given, options)) or "figure")
    specimen = SimpleNamespace(section="solid")

    def of(observed: Any, **more: Any) -> evidence.Evidence:
        experiment: Any = SimpleNamespace(observed=observed, model=SimpleNamespace(specimen=specimen))
        states: Any = tuple(SimpleNamespace(index=i, field_mT=1.25 * i, tip_force_N=0.01234 * i) for i in (1, 4))
        used: Any = SimpleNamespace(in_words=lambda: "2 of 5 states")
        return evidence.Evidence(Path("in/run.h5"), "12", experiment, states, used, **more)

    places = np.arange(12.0).reshape(2, 3, 2)
    sigma = np.ones((2, 3))
    sigma[1, 2] = np.inf
    points = of(PointObservation(np.zeros((2, 3, 2)), places, sigma, np.zeros((2, 3))))
    assert points.plot() == "figure"
    (states, shown, words), options = drawn[0]
    assert (states, words, options) == (points.states, plotting.OF_BEAM, {"lines": False})
    assert [[part.tolist() for part in state] for state in shown] == [[places[0].tolist()], [places[1, :2].tolist()]]
    sides = np.arange(24.0).reshape(2, 2, 3, 2)
    sigmas = np.ones((2, 2, 3))
    sigmas[0, 1, 0] = np.inf
    doubted = of(EdgeObservation(sides, sigmas), taken_as_exact=("depth_mm", "moment"), doubts=("a lens",))
    assert doubted.plot() == "figure"
    (_, shown, _), options = drawn[1]
    assert options == {"lines": True}
    assert [part.tolist() for part in shown[0]] == [sides[0, 0].tolist(), sides[0, 1, 1:].tolist()]
    table = doubted._repr_html_()
    for words in ("run.h5, section solid: 2 of 5 states", "1.250", "0.0123", ">5<", ">6<", "Doubt: a lens."):
        assert words in table
    assert "Taken as exact, because no uncertainty is given: depth_mm, moment." in table
    assert "Taken as exact" not in points._repr_html_()


# Refusals


def named(slip: Slip) -> NamedCause:
    return NamedCause(1, slip, 1.234, 0.0456)


@pytest.mark.parametrize("slip", before_search._REMEDIES)
@pytest.mark.parametrize("is_edges", [False, True])
def test_a_mistake_in_the_loads_is_named_with_its_remedies(slip: Any, is_edges: bool) -> None:
    experiment: Any = SimpleNamespace(observed=EDGES if is_edges else POINTS)
    words = before_search.in_words(named(slip), Path("run.h5"), experiment)
    remedy = before_search._REMEDIES[slip]
    start, end = words.split("; ", 1)
    assert start == (
        "run.h5: no material explains the measured shape of the beam: with the values in the files the smallest error "
        f"is 1.2 mm, but only 0.046 mm without {named(slip).words}"
    )
    stored = " in calibration.toml, and store this file: eimi segment run.h5 --calibration calibration.toml"
    of_edges = [remedy.calibration + stored] * bool(remedy.calibration) + [remedy.states] * bool(remedy.states)
    assert end == ("; or, for imported pictures, ".join(of_edges) if is_edges else remedy.points)
    data: Any = SimpleNamespace(path=Path("run.h5"), experiment=experiment)
    assert str(fitting.refused(named(slip), [None, data])) == words  # type: ignore[list-item]


def test_each_mistake_in_the_loads_has_its_own_remedies() -> None:
    sides = {
        "field_reversed": (
            "turn field_angle_deg by 180",
            "change the sign of current_A",
            "change the sign of field_mT",
        ),
        "gravity_reversed": ("turn gravity_angle_deg by 180", "", "turn --gravity-angle by 180"),
        "field_too_large": (
            "give coil_constant_mT_per_A",
            "give current_A in states.csv",
            "give field_mT in states.csv",
        ),
        "field_too_small": (
            "give coil_constant_mT_per_A",
            "give current_A in states.csv",
            "give field_mT in states.csv",
        ),
        "force_reversed": ("", "change the sign of tip_force_N", "change the sign of tip_force_N"),
        "force_too_large": ("", "tip_force_N in states.csv is in newton", "tip_force_N in states.csv is in newton"),
        "gravity_absent": ("set gravity = false", "", "give --no-gravity"),
    }
    assert set(sides) == set(before_search._REMEDIES)
    for slip, remedy in before_search._REMEDIES.items():
        for words, start in zip((remedy.calibration, remedy.states, remedy.points), sides[slip], strict=True):
            assert words.startswith(start)
            assert bool(words) is bool(start)


def test_each_check_of_the_states_is_made_and_names_its_dataset(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Any] = []
    for name in ("_check_currents", "_check_magnet", "_check_map"):
        monkeypatch.setattr(before_search, name, lambda *given, name=name: made.append((name, *given)))
    experiment: Any = "experiment"
    before_search.check_states(Path("run.h5"), experiment, ("states",))  # type: ignore[arg-type]
    assert made == [
        ("_check_currents", ("states",)),
        ("_check_magnet", Path("run.h5"), "experiment"),
        ("_check_map", "experiment"),
    ]

    def refuse(*given: Any) -> None:
        raise InputError("no map")

    monkeypatch.setattr(before_search, "_check_map", refuse)
    with pytest.raises(InputError, match=r"^run\.h5: no map$"):
        before_search.check_states(Path("run.h5"), experiment, ())


def test_sections_and_laws_have_their_names() -> None:
    assert [fitting.check_section(name) for name in ("solid", "plane-stress", None)] == ["solid", "plane-stress", None]
    with pytest.raises(InputError, match="--section solids: there is no such section; did you mean 'solid'"):
        fitting.check_section("solids")
    assert fitting.check_models(["yeoh", "ogden", "yeoh"]) == ["yeoh", "ogden"]
    with pytest.raises(InputError, match="--model yeo: there is no law 'yeo'; did you mean 'yeoh'"):
        fitting.check_models(["ogden", "yeo"])


# Records


def law(**more: Any) -> LawRecord:
    given: dict[str, Any] = {
        "model": "yeoh",
        "parameters": {f"C{i}0": Quantity(10.0**i, "Pa", (1.0, 2e3)) for i in (1, 2, 3)},
        "initial_shear_modulus": Quantity(50e3, "Pa", (49e3, 51e3)),
        "max_stretch": 1.25,
        "stability": Stability(criterion="Drucker", stable_up_to_stretch=None, checked_up_to_stretch=8.0),
        "doubts": (Doubt("a doubt", kind="unstable"), Doubt("another", short="short", modulus_percent=2.0)),
        "versions": {"numpy": "2"},
    }
    return LawRecord(**{**given, **more})


def test_a_law_in_a_file_has_its_parameters_in_order_and_finite_numbers() -> None:
    assert law().values() == [10.0, 100.0, 1000.0]
    names = law().parameters
    for changes, words in (
        ({"model": "yeo"}, "model 'yeo' should be one of .*yeoh"),
        ({"parameters": dict(reversed(names.items()))}, "parameters of yeoh should be C10, C20, C30, in this order"),
        ({"initial_shear_modulus": Quantity(np.nan, "Pa", (1.0, 2.0))}, "initial_shear_modulus nan should be a finite"),
        ({"parameters": {**names, "C20": Quantity(np.inf, "Pa", (1.0, 2.0))}}, "C20 inf should be a finite number"),
    ):
        with pytest.raises(ValueError, match=words):
            law(**changes)
    written = law().content()
    assert written["doubts"][0] == {k: v for k, v in vars(law().doubts[0]).items() if k not in HIDDEN}
    assert written["doubts"][1]["short"] == "short"
    assert written["doubts"][1]["modulus_percent"] == 2.0


HIDDEN = ("kind", "short", "modulus_percent")


def test_the_draws_of_a_fit_are_taken_evenly_with_their_inputs() -> None:
    values = tuple((float(i), 2.0 * i, 3.0 * i, 0.1 * i) for i in range(6))
    drawn = law(draws=Draws(1, ("C10", "C20", "C30", "moment"), values))
    assert drawn.drawn().tolist() == [list(row[:3]) for row in values]
    assert drawn.drawn(6).tolist() == drawn.drawn(9).tolist() == drawn.drawn().tolist()
    assert drawn.drawn(3)[:, 0].tolist() == [1.0, 3.0, 5.0]
    assert drawn.drawn(2)[:, 0].tolist() == [1.0, 4.0]
    deviation = drawn.drawn_deviation("moment", 3)
    assert deviation is not None
    assert deviation == pytest.approx([0.1, 0.3, 0.5])
    assert drawn.drawn_deviation("width") is None
    assert law().drawn_deviation("moment") is None
    assert law().drawn().shape == (0, 3)


def test_a_law_is_shown_as_a_table_and_in_words() -> None:
    table = law().to_pandas()
    assert table.loc["C20"].tolist() == [100.0, 1.0, 2e3, "Pa", False]
    assert list(table.columns) == ["value", "low_95", "high_95", "unit", "held_by_bounds"]
    assert table.index.tolist() == ["C10", "C20", "C30", "initial_shear_modulus"]
    html = law()._repr_html_()
    assert "initial shear modulus" in html
    assert "1 to 2000" in html
    assert "Doubt: a doubt." in html
    assert repr(law()) == f"<{law().summary()}>"
    assert law().summary().startswith("yeoh: initial shear modulus ")
    assert law().notes() == []
    whole = "Largest stretch in the data 1.250; beyond this stretch the law is an extrapolation. The law is Drucker-"
    assert law().stretch_in_words() == f"{whole}stable up to a stretch of 8, the largest stretch that was checked."
    stable = Stability(criterion="Drucker", stable_up_to_stretch=1.2345, checked_up_to_stretch=8.0)
    assert law(stability=stable).stretch_in_words() == f"{whole}stable up to 1.23 only."
    assert law().caveats() == [
        f"initial shear modulus {law().modulus_in_words()}, 95 % interval",
        law().stretch_in_words(),
        "doubt: a doubt",
        "doubt: another",
    ]


def test_the_errors_of_states_and_their_indices_are_those_of_the_dataset() -> None:
    states = tuple(SimpleNamespace(index=i, current_A=0.1 * i, field_mT=0.5 * i) for i in (2, 5))
    data: Any = SimpleNamespace(states=states)
    assert StateError.of(data, np.array([0.1, 0.2]), np.array([0.3, 0.4]), 7) == (
        StateError(dataset=7, state=2, current_A=0.2, field_mT=1.0, error_mm=0.1, deviation_mm=0.3),
        StateError(dataset=7, state=5, current_A=0.5, field_mT=2.5, error_mm=0.2, deviation_mm=0.4),
    )
    of_state = Doubt("w", 1, 1, kind="unstable")
    assert records._with_dataset_index(of_state, [None, data]).state == 5  # type: ignore[list-item]
    for whole in (Doubt("w", 1, kind="unstable"), Doubt("w", kind="unstable")):
        assert records._with_dataset_index(whole, [None, data]) is whole  # type: ignore[list-item]
    fit = FitRecord.__new__(FitRecord)
    for name, value in {
        "tensile": (SimpleNamespace(name="pull.csv"),),
        "datasets": (SimpleNamespace(path="a.h5"), SimpleNamespace(path="b.h5")),
        "distances": ("first", "second"),
        "model": "yeoh",
    }.items():
        object.__setattr__(fit, name, value)
    assert fit._about(Doubt("w", curve=0, kind="unstable")) == "pull.csv: "
    assert fit._about(Doubt("w", kind="unstable")) == ""
    assert fit._about(Doubt("w", 1, kind="unstable")) == "b.h5: "
    assert fit._about(Doubt("w", 1, 4, kind="unstable")) == "b.h5, state 4: "
    assert (fit.residuals(), fit.residuals(1)) == ("first", "second")  # type: ignore[comparison-overlap]
    object.__setattr__(fit, "distances", ())
    with pytest.raises(InputError, match=r"yeoh: this fit was read from fits\.json, which contains no residuals"):
        fit.residuals()


def test_residuals_are_tables_with_their_edges_and_arc_lengths() -> None:
    distance = np.arange(8.0).reshape(2, 2, 2)
    distance[1, 0, 1] = np.nan
    one = Residuals("a.h5", np.array([3, 5]), np.array([1.5, 2.5]), ("left", "right"), 10 + distance, distance)
    table = one.to_pandas()
    assert table.index.tolist() == [3, 3, 3, 3, 5, 5, 5]
    assert table["edge"].tolist() == ["left", "left", "right", "right", "left", "right", "right"]
    assert table["field_mT"].tolist() == [1.5] * 4 + [2.5] * 3
    assert table["distance_mm"].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 6.0, 7.0]
    assert table["arc_length_mm"].tolist() == [10.0, 11.0, 12.0, 13.0, 14.0, 16.0, 17.0]
    assert repr(one) == "<Residuals of a.h5: 2 states, 7 points>"
    assert repr(replace(one, edge=("x", "y"))) == "<Residuals of a.h5: 2 states, 4 points>"
    cube = one.to_xarray()
    assert cube["distance"].dims == ("state", "edge", "point")
    assert cube["distance"].attrs == cube["arc_length"].attrs == {"units": "mm"}
    assert cube["field"].values.tolist() == [1.5, 2.5]
    assert cube["state"].values.tolist() == [3, 5]
    assert cube["edge"].values.tolist() == ["left", "right"]
    assert cube.attrs == {"path": "a.h5"}
    assert cube["arc_length"].values[0].tolist() == [[10.0, 11.0], [12.0, 13.0]]


def test_a_fit_is_an_xarray_with_its_draws_and_its_states() -> None:
    fit = bending(
        "yeoh",
        parameters={f"C{i}0": Quantity(10.0**i, "Pa", (1.0 * i, 2e3)) for i in (1, 2, 3)},
        initial_shear_modulus=Quantity(50e3, "Pa", (49e3, 51e3)),
        draws=Draws(1, ("C10", "C20", "C30", "moment"), ((1.0, 2.0, 3.0, 0.1), (4.0, 5.0, 6.0, 0.2))),
        by_state=tuple(
            SimpleNamespace(error_mm=0.1 * k, deviation_mm=0.2 * k, field_mT=1.5 * k, dataset=k % 2, state=10 + k)
            for k in (1, 2, 3)
        ),
    )
    cube = fit.to_xarray()
    assert cube.attrs == {"law": "yeoh"}
    names = ["C10", "C20", "C30", "initial_shear_modulus"]
    assert cube["parameter"].values.tolist() == names
    assert cube["value"].values.tolist() == [10.0, 100.0, 1000.0, 50e3]
    assert cube["interval_95"].dims == ("parameter", "end")
    assert cube["interval_95"].values.tolist() == [[1.0, 2e3], [2.0, 2e3], [3.0, 2e3], [49e3, 51e3]]
    assert cube["end"].values.tolist() == ["low", "high"]
    assert cube["unit"].values.tolist() == ["Pa"] * 4
    assert cube["draw"].values.tolist() == [[1.0, 2.0, 3.0, 0.1], [4.0, 5.0, 6.0, 0.2]]
    assert cube["unknown"].values.tolist() == ["C10", "C20", "C30", "moment"]
    assert cube["error"].values == pytest.approx([0.1, 0.2, 0.3])
    assert cube["deviation"].values == pytest.approx([0.2, 0.4, 0.6])
    assert cube["error"].attrs == cube["deviation"].attrs == {"units": "mm"}
    assert cube["field"].values.tolist() == [1.5, 3.0, 4.5]
    assert cube["field"].attrs == {"units": "mT"}
    assert (cube["dataset"].values.tolist(), cube["number"].values.tolist()) == ([1, 0, 1], [11, 12, 13])
    object.__setattr__(fit, "draws", None)
    without = fit.to_xarray()
    assert without["draw"].shape == (0, 0)
    assert without["unknown"].values.tolist() == []


def test_what_was_measured_of_a_dataset_is_remarked() -> None:
    heating = SimpleNamespace(in_words="at 25 °C")
    warm: Any = SimpleNamespace(path="run.h5", heating=heating)
    cold: Any = SimpleNamespace(path="run.h5", heating=None)
    assert measured_remarks.heating_remark(warm) == "run.h5: the coil was at at 25 °C"
    assert measured_remarks.heating_remark(cold) is None


def test_the_field_of_a_motion_is_that_of_the_measured_line_or_of_the_coil_constant(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(recorded_motions, "loads_of_states", lambda data, states: states)

    def state(**more: Any) -> Any:
        (one,) = recorded_motions._loads(dataset(**more), 2.0, 0.05)
        return one

    assert (state().field_mT, state().current_A, state().tip_force_N) == (0.0, 2.0, 0.05)
    assert state(of=calibration()).field_mT == pytest.approx(9.4)
    assert state(of=calibration(mT_per_A=None)).field_mT == 0.0
    line = SimpleNamespace(mT_per_A=5.0)
    assert state(of=calibration(), field_line=line).field_mT == 10.0
    with pytest.raises(InputError, match=r"run\.h5: a weight of 0\.05 N hangs at the tip, but in this dataset gravity"):
        state(gravity=False)
    (still,) = recorded_motions._loads(dataset(gravity=False), 2.0, 0.0)
    assert still.tip_force_N == 0.0


def test_the_corrections_of_a_fit_are_the_start_for_the_next_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Any] = []

    def simulated(data: Any, law: Any, near: Any, plain: Any, method: str) -> Any:
        seen.append((data, law.fit, list(near), plain, method))
        depth = SimpleNamespace(without_shapes=lambda: f"depth of {law.fit}")
        return f"prediction of {law.fit}", None if law.fit == "b" else depth

    monkeypatch.setattr(simulated_fit, "_simulated", simulated)
    monkeypatch.setattr(simulated_fit, "_planar_comparisons", lambda data, fits: [f"plain {fit}" for fit in fits])
    laws: Any = [SimpleNamespace(fit=name) for name in "abc"]
    data: Any = "data"
    assert list(simulated_fit.simulate_each(data, laws)) == [f"prediction of {name}" for name in "abc"]
    assert seen == [
        ("data", "a", [], "plain a", "interpolate"),
        ("data", "b", ["depth of a"], "plain b", "interpolate"),
        ("data", "c", ["depth of a"], "plain c", "interpolate"),
    ]
    assert simulated_fit.simulate_alone(data, laws[2]) == "prediction of c"  # type: ignore[comparison-overlap]
    assert seen[-1] == ("data", "c", [], "plain c", "follow")


def test_fits_of_one_law_are_simulated_together_unless_they_assume_more(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Any] = []

    class Assumed:
        def __init__(self, fit: Any) -> None:
            self.bulk_modulus_Pa, self.setup = fit.bulk, fit.setup

        def applied(self, experiment: Any) -> Any:
            return f"applied {experiment}"

        def compared(self, model: str, values: np.ndarray, experiment: Any) -> Any:
            made.append((model, values.tolist(), experiment))
            return SimpleNamespace(take=lambda rows: (model, values[rows].tolist()))

    monkeypatch.setattr(simulated_fit, "assumptions_of", lambda fit, data, count: Assumed(fit))
    monkeypatch.setattr(simulated_fit, "polished", lambda experiment: f"polished {experiment}")

    def fit(model: str, value: float, bulk: Any = None, setup: Any = None) -> Any:
        return SimpleNamespace(model=model, values=lambda: [value], bulk=bulk, setup=setup)

    data: Any = SimpleNamespace(experiment="experiment")
    fits = [
        fit("yeoh", 1.0),
        fit("ogden", 2.0),
        fit("yeoh", 3.0, bulk=7.0),
        fit("yeoh", 4.0),
        fit("ogden", 5.0, setup=1),
    ]
    found: Any = simulated_fit._planar_comparisons(data, fits)
    assert found == [("yeoh", [[1.0]]), ("ogden", [[2.0]]), ("yeoh", [[3.0]]), ("yeoh", [[4.0]]), ("ogden", [[5.0]])]
    words = "polished applied experiment"
    assert made == [
        ("yeoh", [[1.0], [4.0]], words),
        ("ogden", [[2.0]], words),
        ("yeoh", [[3.0]], words),
        ("ogden", [[5.0]], words),
    ]


# Comparisons


@dataclass
class Identified:
    # A stand-in for what a fit determines.

    noise_mm: float | None = 0.002
    noise_points: float | None = 40.0
    model_mm: float = 0.003
    stated_squares: float = 1.5
    points: int = 90
    independent_points: float = 33.0
    names: tuple[str, ...] = ("mu", "alpha")


def bending(model: str, **more: Any) -> Any:
    fit = FitRecord.__new__(FitRecord)
    given: dict[str, Any] = {
        "model": model,
        "datasets": (SimpleNamespace(sha256="12", section="solid", states="all"),),
        "tensile": (),
        "identifiability": Identified(),
        "mean_error_mm": 0.02,
        "held_out_error_mm": 0.03,
        **more,
    }
    for name, value in given.items():
        object.__setattr__(fit, name, value)
    return fit


def test_laws_are_compared_if_they_were_fitted_to_the_same_data(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fits_file, "choose", tuple)
    monkeypatch.setattr(FitRecord, "prior_squares", lambda self: 0.25)
    curve = SimpleNamespace(sha256="34", window_percent=50.0, weight=0.5, rows=60, correlation_rows=4.0, rmse_Pa=350.0)
    best = Identified(noise_mm=0.001, model_mm=0.004, noise_points=50.0, names=("mu",), stated_squares=0.0)
    fits = [bending("yeoh", tensile=(curve,)), bending("ogden", tensile=(curve,), identifiability=best)]
    one, other = fits_file._comparison(fits)
    assert (one.model, one.unknowns, one.held_out_error_mm, one.stated_squares) == ("yeoh", 2, 0.03, 1.75)
    assert one.errors == ((40.0, pytest.approx(np.hypot(0.002, 0.004))), (7.5, 350.0))
    assert (other.model, other.unknowns, other.stated_squares) == ("ogden", 1, 0.25)
    assert other.errors == ((50.0, pytest.approx(np.hypot(0.001, 0.004))), (7.5, 350.0))
    old = [bending(model, identifiability=Identified(noise_mm=None)) for model in ("yeoh", "ogden")]
    assert [c.errors for c in fits_file._comparison([old[0], bending("ogden")])] == [((33.0, 0.02),)] * 2
    assert fits_file._comparison(old)[0].stated_squares == 0.25
    section = (SimpleNamespace(sha256="12", section="plane-stress", states="all"),)
    states = (SimpleNamespace(sha256="12", section="solid", states="some"),)
    for second in (
        bending("yeoh"),
        bending("ogden", datasets=section),
        bending("ogden", datasets=states),
        bending("ogden", tensile=(curve,)),
        bending("ogden", identifiability=Identified(points=91)),
    ):
        assert fits_file._comparison([bending("yeoh"), second]) == ()
    assert fits_file._comparison([bending("yeoh")]) == ()
    tension: Any = SimpleNamespace(model="gent")
    assert fits_file._comparison([bending("yeoh"), bending("ogden"), tension]) == ()


# Assumptions of a simulation


def test_a_simulation_takes_the_bulk_modulus_and_the_inputs_of_its_fit() -> None:
    def value(name: str, size: float, datasets: tuple[int, ...]) -> Any:
        return SimpleNamespace(name=name, deviation=Quantity(size, "1", (0.0, 1.0)), datasets=datasets)

    specimen = SimpleNamespace(section="plane-strain")
    data: Any = SimpleNamespace(
        sha256="34", experiment=SimpleNamespace(model=SimpleNamespace(specimen=specimen), observed=EDGES)
    )
    freed = (value("moment", 0.02, (1,)), value("width", 0.1, (0, 1)), value("clamp y", 0.3, (1,)))
    fit = bending(
        "yeoh",
        bulk_modulus=Quantity(7e6, "Pa", (5e6, 9e6)),
        datasets=(SimpleNamespace(sha256="12"), SimpleNamespace(sha256="34")),
        freed=freed,
    )
    found = assumptions.assumptions_of(fit, data, 3)
    assert found.bulk_modulus_Pa is not None
    assert found.bulk_modulus_Pa.tolist() == [7e6] * 3
    assert {key: numbers.tolist() for key, numbers in found.deviations.items()} == {"width": [0.1]}
    assert found.setup is not None
    other = assumptions.assumptions_of(fit, SimpleNamespace(**{**vars(data), "sha256": "12"}), 1)  # type: ignore[arg-type]
    assert {key: numbers.tolist() for key, numbers in other.deviations.items()} == {"width": [0.1]}
    unknown = assumptions.assumptions_of(fit, SimpleNamespace(**{**vars(data), "sha256": "56"}), 2)  # type: ignore[arg-type]
    assert (unknown.setup, dict(unknown.deviations)) == (None, {})
    assert unknown.bulk_modulus_Pa is not None
    specimen.section = "solid"
    assert assumptions.assumptions_of(fit, data, 3).bulk_modulus_Pa is None
    tension: Any = SimpleNamespace(model="yeoh")
    assert assumptions.assumptions_of(tension, data, 1).bulk_modulus_Pa is None


def test_an_input_that_the_fit_shares_keeps_the_deviations_of_the_fit() -> None:
    stated = (StatedSource("coil", 0.02, "coil 1"), StatedSource("width", 0.03, "beam 1"))
    drawn: list[Any] = []

    def deviation(name: str, most: int) -> Any:
        drawn.append((name, most))
        return np.array([0.01, -0.04])

    fit = bending("yeoh", datasets=(SimpleNamespace(stated=stated),))
    object.__setattr__(fit, "drawn_deviation", deviation)
    shared = predicted_error._shared_deviations(fit, StatedSource("coil", 0.5, "coil 1"), 0, 2)
    assert shared is not None
    assert shared == pytest.approx([0.5, -2.0])
    assert drawn == [("coil constant", 2)]
    assert predicted_error._shared_deviations(fit, StatedSource("coil", 0.5, "coil 2"), 0, 2) is None
    object.__setattr__(fit, "drawn_deviation", lambda name, most: None)
    assert predicted_error._shared_deviations(fit, StatedSource("coil", 0.5, "coil 1"), 0, 2) is None
    assert LAWS["yeoh"].parameter_names == ("C10", "C20", "C30")
