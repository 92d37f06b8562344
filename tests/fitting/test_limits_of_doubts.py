"""A fit gives a warning or names a cause if a quantity is just above its limit, but not if it is just below."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eimi_fitting import LAWS, Magnet, Specimen
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.twist import torsion_constant_mm4
from eimi_fitting.beam.view import View
from eimi_fitting.inference.doubts import (
    cause_doubts,
    causes_in_pictures,
    causes_in_specimens,
    named_error,
    twisted_picture,
)
from eimi_fitting.inference.doubts.causes import NONE, Cause, Weighed, _most_probable, _of_classes
from eimi_fitting.inference.doubts.coefficients import Coefficients, _blocks
from eimi_fitting.inference.doubts.collinear_causes import classes
from eimi_fitting.inference.doubts.deviating_inputs import Deviation
from eimi_fitting.inference.doubts.edge_coefficients import projection
from eimi_fitting.inference.doubts.marginal_likelihood import weigh
from eimi_fitting.inference.doubts.possible_causes import Assumed, of_source
from eimi_fitting.inference.doubts.signatures import Column, LinearisedFit, Solved
from eimi_fitting.inference.doubts.table_of_causes import POSSIBLE_CAUSES
from eimi_fitting.inference.doubts.twisted_picture import tip_twist_per_tilt, without_twist
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation, PointObservation
from eimi_fitting.inference.evidence.quantity import NORMAL_95, Quantity
from eimi_fitting.inference.evidence.sources import SOURCES, StatedSource
from eimi_fitting.inference.interval.identifiability import Identifiability
from eimi_fitting.inference.planning.choice_of_law import Candidate, choose

CAUSES = {cause.name: cause for cause in POSSIBLE_CAUSES}
DOCS = Path(__file__).parents[2] / "docs" / "why" / "causes.md"


def documented() -> dict[str, list[str]]:
    # Return the table of causes in docs/why/causes.md: the cells of each row, by the name in its first cell.
    table = DOCS.read_text(encoding="utf-8").partition("\n## The causes\n")[2].partition("\n\nA moment")[0]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.strip().splitlines()[2:]]
    return {cells[0].strip("`"): cells[1:] for cells in rows}


def test_the_documentation_has_a_row_for_each_cause_with_its_first_size_and_its_source() -> None:
    rows = documented()
    assert set(rows) == set(CAUSES)
    for cause in POSSIBLE_CAUSES:
        words, free, _ = rows[cause.name]
        assert free.strip("`") == cause.source
        if number := re.match(r"([\d.]+) (%|deg|mm|mT|/m)", words):
            unit = {"/m": "1/m", "%": "1"}.get(number[2], number[2])
            assert (float(number[1]) * (0.01 if number[2] == "%" else 1.0), unit) == pytest.approx(
                (cause.sizes[0], cause.unit)
            )


SIZES = {
    "roll": (1.0,),
    "clamp_angle": (0.5,),
    "clamp_offset": (0.3, 0.3),
    "scale": (0.01,),
    "distance": (5.0,),
    "distortion": (0.01, 0.005, 0.005, 0.1, 0.1),
    "camera_pitch": (1.0, 1.0),
    "clamp_softness": (0.3,),
    "rest_shape": (0.5, 0.3, 0.3),
    "taper": (0.06, 0.03),
    "width": (0.05,),
    "magnetisation_angle": (3.0,),
    "magnetisation_out_of_plane": (3.0,),
    "section": (1.0,),
    "law": (0.3, 0.3),
    "moment": (0.05,),
    "field_direction": (2.0,),
    "field_gradient": (2.0, 2.0, 2.0),
    "background_field": (0.05, 0.05),
    "creep": (0.1,),
    "hysteresis": (0.05,),
}
"""The prior sizes of all components of each cause, as docs/why/causes.md explains them."""


def test_each_cause_has_its_prior_sizes() -> None:
    assert {cause.name: cause.sizes for cause in POSSIBLE_CAUSES} == SIZES
    assert {cause.name: cause.shown for cause in POSSIBLE_CAUSES if cause.shown is not None} == {"distortion": 1}


BEAM = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-stress", Magnet(4.0, 3.0, 2.0, 1.2, 7500.0))
POINTS = np.array([[[[2.0, 1.0], [12.0, 1.0], [32.0, 11.0]], [[2.0, -1.0], [12.0, -1.0], [32.0, 9.0]]]])


def seen(view: View | None = None) -> Experiment:
    # Return one measured load step with three points on each edge; the picture centre is (17 mm, 5 mm).
    sigma = np.full((1, 2, 3), 0.01)
    return Experiment(BeamModel(BEAM, 4, 1), Loads.along([5.0]), EdgeObservation(POINTS, sigma, view=view))


def moved(name: str, *amplitudes: float, view: View | None = None) -> np.ndarray:
    # Return how far (mm) the cause `name` of residuals, with these amplitudes, moves the measured points.
    assumed: Any = SimpleNamespace(experiment=seen(view))
    change = CAUSES[name].change
    assert change is not None
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(causes_in_pictures, "replace", lambda one, **new: _replaced(one, new))
        return POINTS - change(assumed, np.array(amplitudes)).experiment.observed.points_mm


def _replaced(one: Any, new: dict[str, Any]) -> Any:
    return SimpleNamespace(**new) if isinstance(one, SimpleNamespace) else replace(one, **new)


CENTRE = np.array([17.0, 5.0])


def test_a_beam_that_is_farther_away_looks_smaller() -> None:
    assert moved("distance", 6.0) == pytest.approx(-6.0 / 300.0 * POINTS)  # 300 mm unless it is stated
    view = View(np.array([10.0, 0.0]), 100.0)
    assert moved("distance", 6.0, view=view) == pytest.approx(-6.0 / 100.0 * POINTS)


def test_a_tilted_camera_enlarges_one_side_of_the_picture() -> None:
    from_centre = POINTS - CENTRE
    nearer = (from_centre @ np.radians([1.0, -2.0])) / 300.0
    at_clamp = (-CENTRE @ np.radians([1.0, -2.0])) / 300.0 * -CENTRE
    assert moved("camera_pitch", 1.0, -2.0) == pytest.approx(nearer[..., None] * from_centre - at_clamp)


def test_a_distortion_grows_with_the_cube_of_the_distance_from_the_lens_axis() -> None:
    farthest = np.sqrt(((POINTS - CENTRE) ** 2).sum(axis=-1).max())

    def radial(places: np.ndarray, axis: np.ndarray) -> np.ndarray:
        share = (places - CENTRE) / farthest - axis
        return farthest * 0.02 * (share**2).sum(axis=-1, keepdims=True) * share

    for off_axis, shift in (([0.0, 0.0], [0.0, 0.0]), ([0.5, -1.0], [0.1, -0.2]), ([1.9, 0.0], [0.0, 0.0])):
        axis = np.array(off_axis)
        expected = radial(POINTS, axis) - radial(np.zeros(2), axis) + shift
        assert moved("distortion", 0.02, *(0.02 * axis), *shift) == pytest.approx(expected)

    def linear(places: np.ndarray, axis: np.ndarray) -> np.ndarray:
        share = (places - CENTRE) / farthest
        square = (share**2).sum(axis=-1, keepdims=True)
        return farthest * 0.02 * (square * (share - axis) - 2 * (share @ axis)[..., None] * share)

    axis = np.array([2.1, 0.0])  # a larger displacement counts linearly
    assert moved("distortion", 0.02, *(0.02 * axis), 0.0, 0.0) == pytest.approx(
        linear(POINTS, axis) - linear(np.zeros(2), axis)
    )


def test_tracked_points_are_corrected_like_edges() -> None:
    rest = np.array([[2.0, 0.0], [32.0, 10.0]])
    observed = PointObservation(rest, rest[None] + 1.0, np.array([[0.01, 0.02]]))
    assumed: Any = SimpleNamespace(experiment=Experiment(BeamModel(BEAM, 4, 1), Loads.along([5.0]), observed))
    change = CAUSES["distance"].change
    assert change is not None
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(causes_in_pictures, "replace", lambda one, **new: _replaced(one, new))
        found = change(assumed, np.array([3.0])).experiment.observed
    assert found.moved_mm == pytest.approx(1.01 * observed.moved_mm)
    assert found.rest_mm is observed.rest_mm


def test_a_distortion_of_one_tracked_point_is_measured_in_half_of_its_distance_from_the_clamp() -> None:
    rest, displaced = np.array([[29.0, 0.0]]), np.array([[[28.0, 5.0]]])
    observed = PointObservation(rest, displaced, np.array([[0.05]]))
    assumed: Any = SimpleNamespace(experiment=Experiment(BeamModel(BEAM, 4, 1), Loads.along([5.0]), observed))
    change = CAUSES["distortion"].change
    assert change is not None
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(causes_in_pictures, "replace", lambda one, **new: _replaced(one, new))
        corrected = change(assumed, np.array([0.01, 0.0, 0.0, 0.0, 0.0])).experiment.observed.moved_mm
    # The radius is half of the distance between the point and the clamp. The displacement grows with the cube of the
    # distance: it is 1 % of the radius at one radius, and 2**3 % of the radius at the clamp.
    assert corrected == pytest.approx((1.0 - 0.5 * 0.01 * 2.0**3) * displaced)


def test_a_taper_has_a_linear_and_a_waisted_part() -> None:
    assumed = causes_in_specimens.Assumed(LAWS["neo-hookean"], np.array([[40e3]]), None, seen())
    change = CAUSES["taper"].change
    assert change is not None
    plain = change(assumed, np.array([0.1, 0.0]))
    assert plain.deviations == (("taper", 0, 0.1),)
    assert plain.experiment is assumed.experiment
    waisted = change(assumed, np.array([0.0, 0.06])).experiment.model
    flexible = BEAM.flexible_length_mm
    middle, ends = waisted.grid.strip.width_mm(np.array([0.5 * flexible, 0.0]))
    assert ends - middle == pytest.approx(0.06, rel=1e-6)
    softness = CAUSES["clamp_softness"].change
    assert softness is not None
    assert softness(assumed, np.array([0.2])).deviations == (("length", 0, 0.2), ("clamp", 0, -0.2))
    assert softness(assumed, np.array([0.0])).deviations == ()


def test_an_untwisted_picture_is_narrower_by_the_turned_depth() -> None:
    law, parameters = LAWS["neo-hookean"], np.array([[40e3]])
    model = BeamModel(BEAM, 8, 1)
    shapes = model.solve(law, parameters, Loads.along([5.0]))
    line = (
        (model.mesh.nodes + shapes.displacement[0])[:, model.mesh.row(0)],
        (model.mesh.nodes + shapes.displacement[0])[:, model.mesh.row(-1)],
    )
    points = np.stack([one[0, 1:14:3] for one in line])[None]
    experiment = Experiment(model, Loads.along([5.0]), EdgeObservation(points, np.full((1, 2, 5), 0.01)))
    twist = tip_twist_per_tilt(experiment, law, parameters)
    assert twist is not None
    assert without_twist(experiment, experiment, law, parameters, 0.0) is experiment
    plain = replace(experiment, model=BeamModel(replace(BEAM, magnet=None), 8, 1))
    assert without_twist(experiment, plain, law, parameters, 3.0) is experiment
    for angle_deg in (3.0, -3.0):
        found = without_twist(experiment, experiment, law, parameters, angle_deg).observed.points_mm
        by = np.linalg.norm(found - points, axis=-1)
        assert (np.diff(by, axis=-1) > 0).all()  # the twist grows toward the magnet
        width = [np.linalg.norm(edges[0, 0] - edges[0, 1], axis=-1) for edges in (points, found)]
        change = width[1] - width[0]
        assert (np.sign(change) == -np.sign(angle_deg)).all()
        last = np.radians(3.0) * twist[0]
        wider = 3.0 * (np.cos(last) - 1) + np.copysign(5.0 * np.sin(np.abs(last)), angle_deg)
        assert abs(change[-1]) < abs(wider)
        assert abs(change[-1]) > 0.6 * abs(wider)


def test_a_bent_beam_has_the_moments_of_its_curvature_and_the_forces_beyond_each_section() -> None:
    specimen = replace(BEAM, magnet=None)
    model, loads = BeamModel(specimen, 8, 1), Loads.along([0.0], tip_force_N=[0.02])
    radius_mm, along_mm = 25.0, model.grid.straight_mm[model.mesh.row(0), 0]
    angle = along_mm / radius_mm
    arc_mm = radius_mm * np.stack([np.sin(angle), 1 - np.cos(angle)], axis=-1)[None]
    experiment: Any = SimpleNamespace(model=model, loads=loads)
    moments, forces = twisted_picture._moments_and_forces(arc_mm, along_mm, experiment, 40e3)
    # 3 G is the stiffness of an incompressible material in tension; b h^3 / 12 is the second moment of area.
    expected = 3 * 40e3 * (specimen.depth_mm * specimen.width_mm**3 / 12 * 1e-12) / (radius_mm * 1e-3)
    assert moments[0] == pytest.approx(np.full(len(along_mm) - 1, expected), rel=1e-6)
    between_mm = 0.5 * (along_mm[1:] + along_mm[:-1])
    weight = 1e-9 * specimen.density_kg_m3 * specimen.width_mm * specimen.depth_mm * (specimen.length_mm - between_mm)
    assert forces[0] == pytest.approx(weight[:, None] * loads.gravity[0] + loads.tip_force_N[0])


def test_a_twist_has_the_torque_of_the_tilted_moment_and_the_stiffness_of_the_section(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given: list[Any] = []

    def per_tilt(*numbers: Any) -> np.ndarray:
        given.extend(numbers)
        return np.array([[0.0, 0.5, 0.7]])

    monkeypatch.setattr(twisted_picture, "twist_per_tilt", per_tilt)
    loads = Loads.along([5.0], field_angle_deg=30.0)
    experiment: Any = SimpleNamespace(model=BeamModel(BEAM, 8, 1), loads=loads)
    assert tip_twist_per_tilt(experiment, LAWS["neo-hookean"], np.array([[40e3]])) == pytest.approx([0.7])
    middle_mm, _, _, torque, bending, torsion = given
    assert middle_mm.shape[0] == 1
    assert BEAM.magnet is not None
    across = BEAM.magnet.moment_A_m2 * 5e-3 * np.array([[-np.sin(np.radians(30)), np.cos(np.radians(30))]])
    assert torque == pytest.approx(across)
    assert bending == pytest.approx(3 * 40e3 * BEAM.width_mm * BEAM.depth_mm**3 / 12 * 1e-12)
    assert torsion == pytest.approx(40e3 * torsion_constant_mm4(BEAM.width_mm, BEAM.depth_mm) * 1e-12)


def cause(name: str, probability: float, shift: float = 5.0, **more: Any) -> Cause:
    return Cause(name, probability, 0.02, "1", shift, "a ruler", **more)


def weighed(*causes: Cause, **more: Any) -> Weighed:
    found = {one.name: (np.array([0.1, 0.1]),) for one in causes}
    return Weighed(causes, frozenset(), found, **more)


def doubts_of(one: Weighed, error_mm: float = 0.3, interval: tuple[float, float] = (96.0, 104.0)) -> list[Any]:
    estimate: Any = SimpleNamespace(initial_shear_modulus=Quantity(100.0, "Pa", interval))
    final: Any = SimpleNamespace(error_mm=np.full((1, 2), error_mm))
    experiments: Any = [SimpleNamespace(stated=())]
    return list(cause_doubts.cause_doubts(one, estimate, final, experiments))


def test_a_cause_is_mentioned_from_a_tenth_on_if_it_matters() -> None:
    assert doubts_of(weighed()) == []
    assert doubts_of(weighed(cause("scale", 0.09))) == []
    (doubt,) = doubts_of(weighed(cause(NONE, 0.4), cause("scale", 0.11), modulus_percent=(1.0, 3.0)))
    assert (doubt.kind, doubt.dataset, doubt.modulus_percent) == ("cause", 0, (1.0, 3.0))
    assert doubt.short == "scale of the picture would change the modulus by +1 to +3 %"
    assert doubt.words == (
        "the residuals show: scale of the picture (+2 %, probability 0.11, which would change the modulus by +5 %); "
        "decide by a scale in the plane of the beam (pixels_per_mm), or free this quantity (--free scale=0.02)"
    ).replace("a scale in the plane of the beam (pixels_per_mm)", "a ruler")
    assert doubts_of(weighed(cause("scale", 0.9, is_within_stated=True))) == []
    in_the_fit = replace(weighed(cause("scale", 0.9)), in_the_fit=frozenset({"scale"}))
    assert doubts_of(in_the_fit) == []
    alike = replace(weighed(cause("scale", 0.9, like=("distance",))), in_the_fit=frozenset({"distance"}))
    assert doubts_of(alike) == []


def test_a_cause_inside_the_interval_matters_only_if_it_explains_half_of_the_error() -> None:
    inside = weighed(cause("scale", 0.9, shift=1.0))
    assert doubts_of(inside, error_mm=0.19) == []  # 0.1 mm remains
    assert len(doubts_of(inside, error_mm=0.21)) == 1
    assert len(doubts_of(replace(inside, modulus_percent=(1.0, 5.0)), error_mm=0.19)) == 1


def test_a_cause_inside_the_interval_does_not_matter_if_a_file_states_it(monkeypatch: pytest.MonkeyPatch) -> None:
    inside = weighed(cause("scale", 0.9, shift=1.0))
    monkeypatch.setattr(cause_doubts, "_is_stated", lambda one, experiments: one.name == "scale")
    assert doubts_of(inside, error_mm=0.21) == []
    both = replace(
        weighed(cause("scale", 0.9, shift=1.0), cause("width", 0.8, shift=1.0)),
        most_probable=frozenset({"scale", "width"}),
    )
    assert len(doubts_of(both, error_mm=0.21)) == 1  # the width is not stated
    assert doubts_of(replace(both, most_probable=frozenset({"scale"})), error_mm=0.21) == []


def test_without_a_probable_cause_only_residuals_far_above_the_noise_are_a_doubt(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ratio = {"is": 10.1}
    monkeypatch.setattr(cause_doubts, "noise_ratio", lambda experiment, misfit: ratio["is"])
    monkeypatch.setattr(cause_doubts, "pairs", lambda experiments, final: [(None, None)])
    unknown = weighed(cause(NONE, 0.51), cause("scale", 0.4), as_stated=0.51)
    (doubt,) = doubts_of(unknown)
    assert doubt.short == "the residuals have an unknown cause"
    assert doubts_of(replace(unknown, as_stated=0.49))[0].short != doubt.short
    ratio["is"] = 10.0
    assert doubts_of(unknown) == []


def test_inputs_within_their_uncertainty_explain_residuals_near_the_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    ratio = {"is": 10.0}
    monkeypatch.setattr(cause_doubts, "noise_ratio", lambda experiment, misfit: ratio["is"])
    experiments: Any = [SimpleNamespace(observed=SimpleNamespace(of_residuals=lambda residuals: None))]
    one = weighed(cause(NONE, 0.9), as_stated=0.51, remaining=(np.zeros(2),))
    assert cause_doubts.is_as_stated(one, experiments)
    assert not cause_doubts.is_as_stated(replace(one, as_stated=0.49), experiments)
    assert not cause_doubts.is_as_stated(replace(one, remaining=None), experiments)
    assert not cause_doubts.is_as_stated(replace(one, most_probable=frozenset({"scale"})), experiments)
    ratio["is"] = 10.1
    assert not cause_doubts.is_as_stated(one, experiments)


def test_a_cause_is_stated_if_a_file_has_its_uncertainty_or_that_of_one_with_the_same_effect() -> None:
    def is_stated(name: str, *stated: tuple[str, float], like: tuple[str, ...] = ()) -> bool:
        experiment: Any = SimpleNamespace(stated=[StatedSource(key, sigma, "file") for key, sigma in stated])
        return cause_doubts._is_stated(cause(name, 0.9, like=like), [experiment])

    assert is_stated("scale", ("scale", 0.01))
    assert not is_stated("scale", ("scale", 0.0), ("width", 0.1))
    assert is_stated("distance", ("scale", 0.01), like=("scale",))
    assert is_stated("moment", ("remanence", 0.02))
    assert not is_stated("clamp_softness", ("scale", 0.01))


def test_two_causes_are_named_together_from_a_sum_of_six_fifths_on() -> None:
    both = [cause("scale", 0.7), cause("roll", 0.51)]
    assert cause_doubts._causes_in_words(both).startswith("the residuals show: scale of the picture (+2 %, probability")
    assert " and roll of the camera (+2 %" in cause_doubts._causes_in_words(both)
    assert cause_doubts._in_short(both, (2.0, 2.0)) == (
        "scale of the picture and roll of the camera would change the modulus by +2 %"
    )
    either = [cause("scale", 0.7), cause("roll", 0.49)]
    assert "cannot be told apart: scale of the picture" in cause_doubts._causes_in_words(either)
    assert cause_doubts._in_short(either, (2.0, 2.0)).startswith("scale of the picture or roll of the camera")
    assert cause_doubts._present([cause("scale", 0.7), cause("roll", 0.49)]) == either[:1]
    with_unit = Cause("roll", 0.9, 1.5, "deg", 2.0, "a plumb line")
    assert "(+1.5 deg, probability 0.90, which would" in cause_doubts._causes_in_words([with_unit])


def test_freeing_a_cause_is_proposed_where_it_has_an_effect() -> None:
    def words(name: str, *views: Any) -> str:
        experiments: Any = [SimpleNamespace(view=view) for view in views]
        return cause_doubts._to_free(cause(name, 0.9), experiments)

    view = View(np.zeros(2), 300.0)
    assert words("creep", view) == ""
    assert words("scale", None) == ", or free this quantity (--free scale=0.02)"
    assert words("camera_pitch", view, view) == ", or free this quantity (--free tilt=0.02)"
    assert words("camera_pitch", view, None) == ""


@pytest.mark.parametrize(
    ("beside", "most", "error_mm", "is_computed"),
    [
        (0.96, "scale", 0.049, True),
        (0.94, "scale", 0.049, False),
        (0.96, "scale", 0.051, False),
        (0.96, "law", 0.049, False),
        (0.96, "section", 0.049, False),
    ],
)
def test_intervals_beside_a_cause_need_a_probable_cause_that_explains_half_of_the_error(
    monkeypatch: pytest.MonkeyPatch, beside: float, most: str, error_mm: float, is_computed: bool
) -> None:
    one = weighed(cause(most, 0.9), beside_the_fit=beside, most_probable=frozenset({most}), remaining=(np.zeros(2),))
    monkeypatch.setattr(named_error, "remaining_error_mm", lambda *given: error_mm)
    optimum: Any = SimpleNamespace(
        evaluation=SimpleNamespace(
            comparison=SimpleNamespace(
                error_mm=np.full((1, 2), 0.1), misfits=(SimpleNamespace(residuals=np.zeros((1, 2))),)
            )
        )
    )

    class Computed(Exception):
        pass

    def changed(*given: Any) -> Any:
        raise Computed

    monkeypatch.setattr(named_error, "_with_changes", changed)
    problem: Any = SimpleNamespace(experiments=())
    if is_computed:
        with pytest.raises(Computed):
            named_error.estimate_beside(problem, optimum, (), one, None, (), 1)  # type: ignore[arg-type]
    else:
        assert named_error.estimate_beside(problem, optimum, (), one, None, (), 1) is None  # type: ignore[arg-type]


def test_the_modulus_moves_by_shifts_in_per_cent() -> None:
    modulus = Quantity(100.0, "Pa", (95.0, 108.0))
    assert named_error.contains(modulus, (-5.0, 0.0, 8.0))
    assert not named_error.contains(modulus, (-5.1,))
    assert not named_error.contains(modulus, (0.0, 8.1))
    assert named_error.remaining_error_mm(weighed(), []) is None


def test_hypotheses_up_to_a_probability_of_95_per_cent_are_reported() -> None:
    assert _most_probable(np.array([0.04, 0.9, 0.06])).tolist() == [1, 2]
    assert _most_probable(np.array([0.02, 0.96, 0.02])).tolist() == [1]
    assert _most_probable(np.array([0.2, 0.2, 0.2, 0.4])).tolist() == [3, 0, 1, 2]
    assert _most_probable(np.array([0.5, 0.44, 0.06])).tolist() == [0, 1, 2]


def test_deviations_of_one_class_share_one_probability() -> None:
    def deviation(number: int, probability: float, *like: int) -> Deviation:
        return Deviation(number, probability, 0.0, 0.0, like)

    within = {0: deviation(0, 0.3, 1), 1: deviation(1, 0.2, 0), 2: deviation(2, 0.4)}
    assert sorted(_of_classes(within)) == pytest.approx([0.4, 0.5])
    assert _of_classes({0: deviation(0, 0.8, 1), 1: deviation(1, 0.7, 0)}) == [1.0]
    assert _of_classes({}) == []


def test_causes_are_told_apart_from_a_likelihood_ratio_of_nine_on() -> None:
    told = 2 * np.log(9.0)

    def groups(size: float, apart: float, counts: tuple[int, int] = (1, 1)) -> list[tuple[int, ...]]:
        explained = np.array([[0.0, 0.0], [size, 0.0], [size, apart]])
        return sorted(classes(-explained, counts, np.array([1.0, 0.0]), np.array([False, False])))

    nearby = np.sqrt(told + 2)
    assert groups(5.0, 0.98 * nearby) == [(0, 1)]
    assert groups(5.0, 1.02 * nearby) == [(0,), (1,)]
    assert groups(5.0, 1.02 * nearby, (2, 2)) == [(0, 1)]  # each amplitude may fit one more square
    assert groups(300.0, np.sqrt(told + 2 + 0.98 * 6.0**2)) == [(0, 1)]  # two per cent of the change
    assert groups(300.0, np.sqrt(told + 2 + 1.02 * 6.0**2)) == [(0,), (1,)]
    least = np.sqrt(told + 1)
    assert groups(1.01 * least, 0.0) == [(0, 1)]
    assert groups(0.99 * least, 0.0) == [(0,), (1,)]  # a cause that explains nothing is alone
    four = np.array([[0.0, 0.0]] + [[9.0, 0.0]] * 4)
    found = classes(-four, [1] * 4, np.array([3.0, 4.0, 2.0, 1.0]), np.array([False] * 4))
    assert found == [(1, 0, 2), (3,)]  # a class has at most three causes; the first has the largest evidence


def test_unknown_numbers_are_ordered_as_law_inputs_corrections_corners_causes() -> None:
    assert _blocks([[1, 2], [], [3]], 5) == [[5, 6], [], [7]]  # type: ignore[list-item]

    def column(size: float, change: float) -> Column:
        return Column(0, (0,), size, 0.0, (np.full((1, 1, 2), change),))

    about: Any = SimpleNamespace(law_spread=np.array([0.1, 0.2]), slopes=(np.full((2, 1, 1, 2), 7.0),))
    project: Any = SimpleNamespace(of=lambda changes: np.asarray(changes[0])[..., 0, 0, :1])
    effect: Any = SimpleNamespace(remaining_share=0.5, correction=SimpleNamespace(changes=(np.full((1, 1, 2), 4.0),)))
    softness, scale, width = (CAUSES[name] for name in ("clamp_softness", "scale", "width"))
    soft, scaled, stated = column(0.3, 2.0), column(0.01, 3.0), column(0.05, 5.0)
    found = Coefficients.of(about, project, [effect], {width: [stated]}, {softness: [soft], scale: [scaled]})
    assert found.scale == pytest.approx([0.1, 0.2, 0.05, 0.5, 0.01, 0.3, 0.01, 1.0])
    assert found.rows[:, 0] == pytest.approx([0.7, 1.4, 0.25, 2.0, 0.02, 0.6, 0.03, 0.0])
    assert (found.law, found.simulated, found.common) == (2, 3, 5)
    assert (found.of_inputs, found.of_causes) == ([[2]], [[5], [6]])
    assert [found.column(row) for row in (2, 5, 6)] == [stated, soft, scaled]
    assert found.remaining == pytest.approx(np.array([[0.5 / NORMAL_95 * 4.0]]))


def test_an_error_without_a_name_is_averaged_over_its_sizes() -> None:
    rng = np.random.default_rng(2)
    columns = np.concatenate([rng.normal(size=(2, 6)), np.zeros((1, 6))])
    y, noise, error = rng.normal(size=6), np.full(6, 0.5), rng.uniform(0.5, 2.0, 6)
    found = weigh(columns, np.array([[0, 1]]), y[None], noise, error)
    etas = np.concatenate([[0.0], np.geomspace(1e-4, 1.0, 17)])
    logs, means = [], []
    for eta in etas:
        covariance = np.diag(noise + eta**2 * error) + columns.T @ columns
        logs.append(-0.5 * (y @ np.linalg.solve(covariance, y) + np.linalg.slogdet(covariance)[1]))
        means.append(columns[:2] @ np.linalg.solve(covariance, y))
    weights = np.exp(np.array(logs) - max(logs))
    assert found.log_evidence[0] == pytest.approx(np.log(np.mean(np.exp(logs))))
    assert found.means[0, :2] == pytest.approx(weights @ means / weights.sum())
    assert found.error_squared[0] == pytest.approx(etas**2 @ weights / weights.sum())
    assert found.means[0, 2] == found.squares[0, 2] == 0.0


def edges_of(states: int, points: int, sigma: float = 0.1) -> Any:
    loads = Loads.along(np.linspace(1.0, 2.0, states), gravity_angle_deg=None)
    observed = EdgeObservation(np.zeros((states, 2, points, 2)), np.full((states, 2, points), sigma))
    return SimpleNamespace(observed=observed, loads=loads)


def test_residuals_are_described_by_eight_polynomials_on_sums_and_differences_of_the_edges() -> None:
    experiment, place = edges_of(2, 40), np.linspace(-1, 1, 41)[1:]
    polynomial = np.polynomial.legendre.legval(place, np.arange(1.0, 9.0))
    residual = np.broadcast_to(np.stack([polynomial, -polynomial]), (2, 2, 40)).copy()
    found = projection([experiment], [residual], [np.ones((2, 2, 40))])
    coefficients = found.of([residual]).reshape(2, 2, 8)  # states, sides, degrees
    assert (coefficients**2).sum() == pytest.approx((residual**2).sum())  # eight polynomials describe it wholly
    assert np.abs(coefficients[:, 0]).max() < 1e-9  # the width changes, and the middle line does not
    assert found.noise.min() >= 1e-18
    correlation = np.exp(-0.5 * (0.5 / 0.5) ** 2)  # the weaker load is half of the stronger one
    of_loads = np.array([1 - 0.9 * correlation, 1 + 0.9 * correlation])
    errors = found.error.reshape(2, 2, 8)
    by_degree = 1.0 / np.maximum(np.arange(8), 1) ** 4
    for value, error in zip(of_loads, errors, strict=True):
        assert error == pytest.approx(40 * value * np.array([1.8, 0.2])[:, None] * by_degree)
    moves = np.ones((1, found.error.size))
    assert found.smooth(moves) == pytest.approx(found.error * 32.0 / 32.0)
    assert found.of([None, residual][1:]).shape == (32,)


def test_the_noise_of_the_coefficients_is_that_of_the_remainder_of_ten_points_or_more() -> None:
    rng = np.random.default_rng(1)

    def noise(points: int, sigma: float) -> np.ndarray:
        residual = 0.01 * rng.standard_normal((1, 2, points))
        found = projection([edges_of(1, points, sigma)], [residual], [np.ones((1, 2, points))])
        return np.asarray(found.noise)

    assert noise(12, 0.1) == pytest.approx(np.full(16, 0.01))  # eight free points: the stated noise
    assert noise(400, 0.1) == pytest.approx(np.full(16, 1e-4), rel=0.3)
    assert noise(13, 0.1).max() < 2e-3


def test_the_noise_of_tracked_points_counts_a_shift_of_all_points_together() -> None:
    sigma = np.array([[0.1, 0.1, 0.1], [0.1, 0.1, np.inf]])
    observed = PointObservation(np.zeros((3, 2)), np.zeros((2, 3, 2)), sigma)
    experiment: Any = SimpleNamespace(observed=observed, loads=Loads.along([1.0, 2.0], gravity_angle_deg=None))
    used = np.repeat(np.isfinite(sigma)[:, None].astype(float), 2, axis=1)
    found = projection([experiment], [np.zeros((2, 2, 3))], [used])
    assert found.noise.reshape(2, 2, 3)[0, 0] == pytest.approx([0.01 * 2.5, 0.01, 0.01])


def test_a_change_of_a_ten_thousandth_of_a_millimetre_is_seen() -> None:
    change = np.array([0.0, 0.5])
    assert LinearisedFit.is_seen([None, change], 2.1e-4)
    assert not LinearisedFit.is_seen([None, change], 1.9e-4)
    assert not LinearisedFit.is_seen([None], 1.0)


def test_points_near_the_ends_of_an_edge_are_not_used() -> None:
    specimen = Specimen(100.0, 4.0, 4.0, 1070.0, "plane-stress")
    model = BeamModel(specimen, 10, 1)
    along = np.array([0.9, 1.1, 50.0, 96.9, 97.1, 99.0])
    points = np.stack([np.column_stack([along, np.full(6, y)]) for y in (-2.0, 2.0)])[None]
    experiment = Experiment(
        model, Loads.along([0.0], gravity_angle_deg=None), EdgeObservation(points, np.full((1, 2, 6), 0.01))
    )
    assumed = causes_in_specimens.Assumed(LAWS["neo-hookean"], np.array([[1e6]]), None, experiment)
    here = Solved.of(assumed)
    assert here is not None
    expected = [0.0, 1.0, 1.0, 1.0, 0.0, 0.0]  # within 1 % of the length from the clamp, and 3 % from the tip
    assert here.between_ends()[0].tolist() == [expected, expected]
    assert Solved.of(assumed, here).shapes is here.shapes  # type: ignore[union-attr]
    stiffer = Solved.of(replace(assumed, parameters=np.array([[2e6]])), here)
    assert stiffer is not None
    assert stiffer.shapes is not here.shapes


def test_the_weight_of_a_law_follows_its_definition_and_needs_room_for_its_unknowns() -> None:
    def chosen(*unknowns: int, points: float = 12.0) -> tuple[Any, ...]:
        return choose([Candidate(str(k), k, ((points, 1.0 - 0.01 * k),), stated_squares=0.5 * k) for k in unknowns])

    found = chosen(1, 3)
    for choice, k in zip(found, (1, 3), strict=True):
        n, deviance = k + 1, 24.0 * np.log(1.0 - 0.01 * k) + 0.5 * k
        aicc, bic = deviance + 2 * n + 2 * n * (n + 1) / (12 - n - 1), deviance + n * np.log(12)
        base = 24.0 * np.log(0.99) + 0.5
        assert choice.aicc == pytest.approx(aicc - (base + 4 + 12 / 9))
        assert choice.bic == pytest.approx(bic - (base + 2 * np.log(12)))
    assert found[0].weight / found[1].weight == pytest.approx(np.exp(0.5 * found[1].aicc))
    assert found[0].weight + found[1].weight == pytest.approx(1.0)
    assert chosen(9)[0].aicc == 0.0  # one point of room
    assert chosen(9, points=11.9)[0].aicc is None
    assert [one.weight for one in chosen(1, 10)] == [None, None]
    assert chosen() == ()


def test_the_axis_of_the_lens_is_that_of_the_view_or_the_middle_of_the_measured_points() -> None:
    points = np.array([[[[0.0, 2.0], [10.0, 4.0], [99.0, 99.0]], [[6.0, -2.0], [4.0, 0.0], [4.0, 0.0]]]])
    sigma = np.where(points[..., 0] == 99.0, np.inf, 0.01)
    edges = EdgeObservation(points, sigma)
    seen = replace(edges, view=View(centre_mm=np.array([3.0, 1.0]), stand_off_mm=250.0))

    def experiment(observed: Any) -> Any:
        return SimpleNamespace(observed=observed, view=getattr(observed, "view", None))

    assert causes_in_pictures._centre(experiment(edges)).tolist() == [5.0, 1.0]
    assert causes_in_pictures._centre(experiment(seen)).tolist() == [3.0, 1.0]
    assert causes_in_pictures._stand_off_mm(experiment(seen)) == 250.0
    assert causes_in_pictures._stand_off_mm(experiment(edges)) == causes_in_pictures._STAND_OFF_MM
    tracked = PointObservation(points[0], points[0] + 1.0, sigma[0])
    assert causes_in_pictures._centre(experiment(tracked)).tolist() == [6.0, 2.0]
    assert causes_in_pictures._stand_off_mm(experiment(tracked)) == causes_in_pictures._STAND_OFF_MM


def test_a_result_of_an_earlier_version_has_no_noise_beside_the_residuals() -> None:
    found = Identifiability("all are determined", (), (), (), 0.02, 3.0, 200, 60.0, ("mu",), ((1.0,),), (), ())
    assert (found.noise_mm, found.noise_points, found.stated_squares, found.model_mm) == (None, None, 0.0, 0.0)


@pytest.mark.parametrize("source", ["width", "rest-shape", "remanence"])
def test_a_cause_of_one_source_changes_each_part_of_it_by_its_own_size(source: str) -> None:
    found = of_source("a name", source, (0.1,), "a ruler", ("coil",))
    parts = len(SOURCES[source].parts)
    assert (found.source, found.stated_as, found.unit) == (source, (source, "coil"), SOURCES[source].unit)
    assert found.change is not None
    sizes = 0.3 * np.arange(1, parts + 1)
    changed = found.change(Assumed(None, None, None, None, (("depth", 0, 0.5),)), sizes)  # type: ignore[arg-type]
    assert changed.deviations == (("depth", 0, 0.5), *((source, i, sizes[i]) for i in range(parts)))
