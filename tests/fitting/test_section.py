"""Fits with a solid beam model give the right modulus from edges that no planar model reproduces."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from eimi_fitting.beam.beside import SolidBeside, SolidOptions
from eimi_fitting.beam.equilibrium import Status
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.outline import outline, points_on
from eimi_fitting.beam.solid_model import SolidModel
from eimi_fitting.beam.specimen import Magnet, Specimen
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation, PointObservation
from eimi_fitting.inference.identification.whole_fit import identify
from eimi_fitting.laws import LAWS
from tests.shared.estimates import refined

NEO, TRUE_PA = LAWS["neo-hookean"], 46e3
BEAM = Specimen(30.0, 3.0, 5.0, 1070.0, "solid", Magnet(4.0, 3.0, 5.0, 0.48, 7500.0))
SHALLOW = replace(BEAM, magnet=Magnet(4.0, 3.0, 2.0, 1.2, 7500.0))
LOADS = Loads.along([0.0, 2.0, 4.0, 6.0])


def similar_to(*effects):
    return SolidOptions(similar=effects)


@cache
def hidden():
    # Return the solid model of the true beam on a fine mesh, and its shapes under the loads.
    model = SolidModel(BEAM, 30, 3, more=1)
    return model, model.solve(NEO, np.array([[TRUE_PA]]), LOADS, tolerance_mm=1e-3)


def observed(sigma_mm=0.001):
    model, shapes = hidden()
    curves = points_on(outline(model, shapes)[0], 2)[:, :, 4:-2]
    rng = np.random.default_rng(1)
    sigma = np.full(curves.shape[2], sigma_mm)
    return EdgeObservation.from_edges(
        [
            (*(part for side in curve for part in (side + sigma_mm * rng.normal(size=side.shape), sigma)),)
            for curve in curves
        ]
    )


def experiment(section):
    specimen = replace(BEAM, section=section)
    model = BeamModel(specimen, plane=specimen.planar_section).refined()
    return Experiment(model, LOADS, observed())


def mean_error_mm(end):
    return end.optimum.evaluation.comparison.error_mm[0].mean()


def test_the_modulus_of_a_solid_is_right_where_planar_sections_are_biased():
    solid = identify("neo-hookean", [experiment("solid")])
    end = refined("neo-hookean", [experiment("plane-strain")], 0.8 * TRUE_PA)
    strain = end.estimate
    modulus = solid.initial_shear_modulus
    assert modulus.value == pytest.approx(TRUE_PA, rel=0.005)
    assert modulus.interval_95[0] < TRUE_PA < modulus.interval_95[1]
    assert solid.mean_error_mm < 0.003
    assert solid.section_change.change_percent < -1
    assert strain.initial_shear_modulus.value < 0.82 * TRUE_PA
    assert mean_error_mm(end) > 5 * solid.mean_error_mm
    assert strain.section_change is None


@pytest.mark.parametrize("specimen", [BEAM, SHALLOW], ids=["a magnet over the depth", "a shallower one"])
def test_the_depth_effect_of_few_states_predicts_the_others(specimen):
    loads, modulus = Loads.along(np.linspace(0, 6, 11)), np.array([[TRUE_PA]])
    beside = SolidBeside(specimen, 13, 1)
    every = beside.solid.solve(NEO, modulus, loads, tolerance_mm=1e-4)
    first = beside.solve(NEO, modulus, loads)
    assert len(first.effect.places) < 8
    assert first.displacement == pytest.approx(every.displacement, abs=1e-3)
    assert first.max_stretch == pytest.approx(every.max_stretch, abs=1e-3)
    near = beside.solve(NEO, 0.98 * modulus, loads, options=similar_to(first.effect))
    assert len(near.effect.places) < len(first.effect.places)
    every = beside.solid.solve(NEO, 0.98 * modulus, loads, tolerance_mm=1e-4)
    assert near.displacement == pytest.approx(every.displacement, abs=1e-3)


@pytest.mark.parametrize("gravity_deg", [0.0, 90.0], ids=["hanging", "level"])
def test_one_solved_state_is_enough_for_very_similar_parameters(gravity_deg):
    loads = Loads.along(np.linspace(0, 6, 7), gravity_angle_deg=gravity_deg)
    beside = SolidBeside(BEAM, 13, 1)
    effect = beside.solve(NEO, np.array([[TRUE_PA]]), loads).effect
    near = beside.solve(NEO, np.array([[1.003 * TRUE_PA]]), loads, options=similar_to(effect))
    assert len(near.effect.places) == 1
    every = beside.solid.solve(NEO, np.array([[1.003 * TRUE_PA]]), loads, tolerance_mm=1e-4)
    assert near.displacement == pytest.approx(every.displacement, abs=1e-3)
    assert (
        len(beside.solve(NEO, np.array([[TRUE_PA]]), loads).effect.places) > 1
    )  # a depth effect from similar parameters is not stored


def test_parameters_of_the_same_law_with_the_same_planar_shapes_are_not_solved_again(monkeypatch):
    loads, ogden = Loads.along(np.linspace(0, 6, 7)), LAWS["ogden"]
    beside = SolidBeside(BEAM, 13, 1)

    def of_two_terms(
        share,
    ):  # terms of equal exponent give the same material for any division of the modulus between them
        mu = TRUE_PA / 2 * np.array([share, 1 - share, 0.0])
        return np.array([[mu[0], 2.0, mu[1], 2.0, 0.0, 2.0]])

    first = beside.solve(ogden, of_two_terms(0.7), loads)
    expected = beside.solve(ogden, of_two_terms(0.2), loads)
    moved = beside.solve(ogden, 1.002 * of_two_terms(0.2), loads)
    assert moved.displacement != pytest.approx(first.displacement, abs=5e-3)
    options = similar_to(first.effect)
    monkeypatch.setattr(SolidBeside, "_difference", None)
    again = beside.solve(ogden, of_two_terms(0.2), loads, options=options)
    assert again.effect is first.effect
    assert again.displacement == pytest.approx(expected.displacement, abs=1e-4)
    # Another law, another shape and another bulk modulus are each solved.
    for law, parameters, bulk in (
        (NEO, np.array([[TRUE_PA / 2]]), None),  # the same material, described by another law
        (ogden, 1.002 * of_two_terms(0.2), None),
        (ogden, of_two_terms(0.2), np.array([1e3 * TRUE_PA])),
    ):
        with pytest.raises(TypeError):
            beside.solve(law, parameters, loads, bulk_modulus_Pa=bulk, options=options)


def test_the_depth_effect_of_the_most_similar_parameters_is_used():
    loads = Loads.along(np.linspace(0, 6, 7))
    beside = SolidBeside(BEAM, 13, 1)
    effects = [beside.solve(NEO, np.array([[share * TRUE_PA]]), loads).effect for share in (0.8, 1.0, 1.5)]
    for candidate, fewest in ((0.803, 0), (1.003, 1)):
        modulus = np.array([[candidate * TRUE_PA]])
        every = beside.solid.solve(NEO, modulus, loads, tolerance_mm=1e-4)
        for order in (effects, effects[::-1]):
            near = beside.solve(NEO, modulus, loads, options=similar_to(*order))
            assert len(near.effect.places) == 1
            assert near.effect.base.places == effects[fewest].places
            assert near.displacement == pytest.approx(every.displacement, abs=1e-3)
    # A shape from the effect of another candidate is as accurate as one that is solved separately.
    again = beside.solve(NEO, np.array([[TRUE_PA]]), loads, options=similar_to(near.effect))
    assert len(again.effect.places) == 1
    assert again.displacement == pytest.approx(beside.solve(NEO, np.array([[TRUE_PA]]), loads).displacement, abs=1e-3)


def test_a_lower_accuracy_needs_fewer_solved_states():
    loads, modulus = Loads.along(np.linspace(0, 6, 7)), np.array([[0.9 * TRUE_PA]])
    beside = SolidBeside(BEAM, 13, 1)
    effect = beside.solve(NEO, np.array([[TRUE_PA]]), loads).effect
    well, loosely = (
        beside.solve(NEO, modulus, loads, options=SolidOptions(accuracy_mm=accuracy, similar=(effect,)))
        for accuracy in (1e-3, 2e-2)
    )
    assert len(loosely.effect.places) < len(well.effect.places)
    assert 1e-5 < np.abs(loosely.displacement - well.displacement).max() < 2e-2


def test_a_given_planar_shape_is_not_solved_again(monkeypatch):
    loads, modulus = Loads.along(np.linspace(0, 6, 7)), np.array([[TRUE_PA]])
    beside = SolidBeside(BEAM, 13, 1)
    assert beside.has_mesh_of(BeamModel(BEAM, 13, 1, "plane-stress"))
    assert not beside.has_mesh_of(BeamModel(BEAM, 14, 1, "plane-stress"))
    assert not beside.has_mesh_of(BeamModel(replace(BEAM, section="plane-strain"), 13, 1))
    assert not beside.has_mesh_of(BeamModel(replace(BEAM, width_mm=1.1 * BEAM.width_mm), 13, 1, "plane-stress"))
    expected = beside.solve(NEO, modulus, loads)
    flat = beside.planar.solve(NEO, modulus, loads, tolerance_mm=1e-2)
    monkeypatch.setattr(BeamModel, "solve", None)
    assert beside.solve(NEO, modulus, loads, options=SolidOptions(planar_shapes=flat)).displacement == pytest.approx(
        expected.displacement
    )


def test_every_state_is_solved_if_the_loads_are_not_proportional():
    loads = Loads.along([0.0, 3.0, 3.0], gravity_angle_deg=0.0, tip_force_N=[0.0, 0.0, 0.003])
    beside = SolidBeside(BEAM, 13, 1)
    shapes = beside.solve(NEO, np.array([[TRUE_PA]]), loads)
    every = beside.solid.solve(NEO, np.array([[TRUE_PA]]), loads, tolerance_mm=1e-4)
    assert shapes.effect is None
    assert shapes.displacement == pytest.approx(every.displacement, abs=1e-3)


def test_without_a_depth_effect_the_planar_model_predicts_the_next_solid_state(monkeypatch):
    loads, spent = Loads.along([0.0, 3.0, 3.0], gravity_angle_deg=0.0, tip_force_N=[0.0, 0.0, 0.003]), []
    beside, modulus = SolidBeside(BEAM, 13, 1), np.array([[TRUE_PA]])
    plain = beside.solid.solve(NEO, modulus, loads)
    solve = SolidModel.solve

    def counted(*arguments, **named):
        result = solve(*arguments, **named)
        spent.append(int(result.iterations.sum()))
        return result

    monkeypatch.setattr(SolidModel, "solve", counted)
    assert beside.solve(NEO, modulus, loads).displacement == pytest.approx(plain.displacement, abs=1e-3)
    led, *_ = spent
    assert led < beside.solid.solve(NEO, modulus, loads, tolerance_mm=1e-2).iterations.sum()


def test_a_solid_far_from_its_planar_model_is_solved_in_load_steps_on_request():
    # The loads are not proportional, so that every state is solved separately.
    loads, modulus = Loads.along([0.0, 3.0, 3.0], gravity_angle_deg=0.0, tip_force_N=[0.0, 0.0, 0.003]), [[TRUE_PA]]
    beside = SolidBeside(BEAM, 13, 1)
    given_up = beside.solve(NEO, np.array(modulus), loads, options=SolidOptions("interpolate"))
    assert (given_up.status == Status.DIVERGED).all()
    followed = beside.solve(NEO, np.array(modulus), loads, options=SolidOptions("follow"))
    assert followed.converged.all()
    assert followed.displacement == pytest.approx(beside.solve(NEO, np.array(modulus), loads).displacement)
    on_a_ray = Loads.along([0.0, 3.0, 6.0])
    near = beside.solve(NEO, np.array(modulus), on_a_ray, options=SolidOptions("interpolate"))
    assert near.converged.all()
    assert beside.solve(NEO, np.array(modulus), on_a_ray, options=SolidOptions("follow")).effect is None


def test_the_depth_effect_is_interpolated_in_fields_of_both_polarities_up_and_down():
    fields = np.array([0.0, 3.0, 6.0, 3.0, 0.0, -3.0, -6.0])
    beside, modulus = SolidBeside(SHALLOW, 13, 1), np.array([[TRUE_PA]])
    shapes = beside.solve(NEO, modulus, Loads.along(fields), options=SolidOptions("interpolate"))
    assert shapes.converged.all()
    assert len(shapes.effect.places) <= 5
    on_one_side = beside.solve(NEO, modulus, Loads.along(fields[:3]))
    assert shapes.displacement[:, :3] == pytest.approx(on_one_side.displacement, abs=2e-3)


def test_the_last_shape_is_that_of_the_last_state():
    loads, modulus = Loads.along(np.linspace(0, 6, 7)), np.array([[TRUE_PA]])
    beside = SolidBeside(BEAM, 13, 1)
    shapes = beside.solve(NEO, modulus, loads)
    assert shapes.last.displacement == pytest.approx(shapes.displacement[:, -1])
    assert shapes.last.rigid == pytest.approx(shapes.rigid[:, -1])
    on = beside.solid.solve(NEO, modulus, Loads.along([6.0]), start=shapes.last, tolerance_mm=1e-2)
    assert on.iterations[0, 0] == 1
    near = beside.solve(NEO, 0.95 * modulus, loads, options=similar_to(shapes.effect))
    places = np.array([0.01, 0.05, 0.2])
    moved, turned = near.effect.displacements(places)
    for place, nodes, body in zip(places, moved, turned, strict=True):
        assert nodes == pytest.approx(near.effect.at(place).displacement[0])
        assert body == pytest.approx(near.effect.at(place).rigid[0])


def test_tracked_points_are_compared_at_their_depth():
    model, shapes = hidden()
    rest = np.array([[x, y] for x in (8.0, 16.0, 24.0) for y in (-1.4, 1.4)])
    depth = np.full(len(rest), 2.4)
    moved = model.positions(shapes, np.column_stack([rest, depth]))[0, :, :, :2]
    k = len(LOADS)
    every = [np.tile(rest, (k, 1, 1)), moved, np.full((k, len(rest)), 0.002)]
    flat = BeamModel(BEAM, plane="plane-stress").refined()
    fit = identify("neo-hookean", [Experiment(flat, LOADS, PointObservation(*every, np.tile(depth, (k, 1))))])
    amid = refined("neo-hookean", [Experiment(flat, LOADS, PointObservation(*every))], TRUE_PA)
    assert fit.initial_shear_modulus.value == pytest.approx(TRUE_PA, rel=0.005)
    assert fit.mean_error_mm < 0.003 < mean_error_mm(amid)
