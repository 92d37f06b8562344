"""The bent beam agrees with exact and published results, and a failed computation gives a status."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.beam.equilibrium import Status
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.solid_model import SolidModel
from eimi_fitting.beam.specimen import Magnet, Specimen
from eimi_fitting.laws import LAWS

NEO = LAWS["neo-hookean"]
MU = np.array([[0.05e6]])


def magnet_tipped(depth_share: float = 1.0) -> tuple[Specimen, float]:
    # Return a beam of 30 x 3 mm with a rigid magnet of 4 mm at its tip, and a field (mT).
    # depth_share : share of the depth of the beam that the magnet fills
    magnet = Magnet(4.0, 3.0, 1.0, 1.0, 7500.0)
    depth = 1.0 / depth_share
    specimen = Specimen(30.0, 3.0, depth, 1070.0, "plane-strain", magnet)
    return specimen, 0.0323 * depth / magnet.moment_A_m2


@pytest.mark.parametrize("mesh", [(13, None), (40, 4)])
def test_a_beam_with_a_magnet_without_gravity_agrees_with_felupe(mesh):
    specimen, field = magnet_tipped()
    model = BeamModel(specimen, *mesh)
    shapes = model.solve(NEO, MU, Loads.along(np.linspace(0, field, 8), gravity_angle_deg=None))
    # FElupe 11.3 on 240 x 24 bilinear elements: 57.332 degrees; elastica 57.481, Rivlin 57.571.
    assert model.tip_angle_deg(shapes)[0, -1] == pytest.approx(57.332, rel=0.005)


@pytest.mark.parametrize("mesh", [(13, None), (40, 4)])
def test_a_beam_with_a_magnet_and_gravity_agrees_with_felupe(mesh):
    # The magnet fills a fifth of the depth, silicone the rest; the reference counts y from the lower edge at rest.
    specimen, field = magnet_tipped(0.2)
    model = BeamModel(specimen, *mesh)
    shapes = model.solve(NEO, MU, Loads.along(np.linspace(0, field, 8), gravity_angle_deg=0.0))
    tip = model.positions(shapes, np.array([[30.0, 0.0]]))[0, -1, 0]
    # FElupe 11.3: 60 x 6 elements 52.439 degrees, tip (25.3678, 15.0608) mm; 240 x 24 52.284 degrees.
    assert model.tip_angle_deg(shapes)[0, -1] == pytest.approx(52.439, rel=0.005)
    assert tip[0] == pytest.approx(25.3678, rel=0.005)
    assert tip[1] + 1.5 == pytest.approx(15.0608, rel=0.005)


@pytest.mark.parametrize(("angle", "ratio"), [(30, 0.99891), (60, 0.99565), (90, 0.99031), (180, 0.96314)])
def test_pure_bending_agrees_with_rivlins_solution(angle, ratio):
    # Pure bending of a block, Rivlin 1949, Phil. Trans. A 242:173: M = (mu/alpha^2)(sinh(4k)/4 - k), sinh 2k = alpha H.
    # The field rotates with the tip, so that the moment on the magnet does not vanish at 90 degrees.
    # Clamp and magnet prevent a change of the section, unlike Rivlin's solution. The curvature is taken between
    # two sections away from them.
    specimen, _ = magnet_tipped()
    height, length = 3.0, 26.0
    mu = 0.05

    def rivlin_moment(alpha):
        k = 0.5 * np.arcsinh(alpha * height)
        return mu / alpha**2 * (0.25 * np.sinh(4 * k) - k)

    angles = np.radians(np.linspace(0, angle, 13)[1:])
    moments = rivlin_moment(angles / length)
    field = moments / (1e3 * specimen.magnet.moment_A_m2)
    direction = np.column_stack([-np.sin(angles), np.cos(angles)])
    loads = Loads(field[:, None] * direction, np.zeros((12, 2)), np.zeros((12, 2)))
    model = BeamModel(specimen, 20)
    shapes = model.solve(NEO, MU, loads)
    assert shapes.converged[0]
    tip = np.radians(model.tip_angle_deg(shapes)[0, -1])
    moment = moments[-1] * np.cos(tip - angles[-1])
    sections = np.array([[x, y] for x in (8.0, 18.0) for y in (-1.5, 1.5)])
    place = model.positions(shapes, sections)[0, -1]
    across = place[1::2] - place[0::2]
    rotation = np.unwrap(np.arctan2(-across[:, 0], across[:, 1]))
    alpha = (rotation[1] - rotation[0]) / 10.0
    assert moment == pytest.approx(rivlin_moment(alpha), rel=0.005)
    nominal = np.radians(angle) / length
    assert rivlin_moment(nominal) / (4 * mu * height**3 / 12 * nominal) == pytest.approx(ratio, abs=1e-5)


def test_plane_stress_bends_by_three_quarters_of_the_plane_strain_stiffness():
    magnet = Magnet(4.0, 1.0, 1.0, 1.0, 7500.0)
    angles = []
    for section in ("plane-strain", "plane-stress"):
        model = BeamModel(Specimen(54.0, 1.0, 1.0, 1070.0, section, magnet))
        shapes = model.solve(NEO, MU, Loads.along([0.001 / magnet.moment_A_m2 * 0.01], gravity_angle_deg=None))
        angles.append(model.tip_angle_deg(shapes)[0, 0])
    # Clamp and magnet stiffen the beam in plane strain slightly: by one per cent over a length of 50 widths.
    assert angles[1] / angles[0] == pytest.approx(4 / 3, rel=0.01)


def test_a_slender_cantilever_bends_under_a_tip_force_as_in_beam_theory():
    # Small deflection F L^3 / (3 EI) with EI = 3 mu I in plane stress.
    specimen = Specimen(100.0, 2.0, 4.0, 0.0, "plane-stress")
    force = 1e-6
    model = BeamModel(specimen, 26)
    shapes = model.solve(NEO, MU, Loads.along(0.0, gravity_angle_deg=90.0, tip_force_N=force))
    tip = model.positions(shapes, np.array([[100.0, 0.0]]))[0, 0, 0]
    bending = 3 * 0.05 * 4.0 * 2.0**3 / 12
    assert tip[1] == pytest.approx(force * 100.0**3 / (3 * bending), rel=0.005)


def test_a_slender_cantilever_bends_under_its_weight_as_in_beam_theory():
    specimen = Specimen(50.0, 2.0, 4.0, 1.0, "plane-stress")
    model = BeamModel(specimen, 26)
    shapes = model.solve(NEO, MU, Loads.along(0.0, gravity_angle_deg=-90.0))
    tip = model.positions(shapes, np.array([[50.0, 0.0]]))[0, 0, 0]
    weight = 1e-9 * 1.0 * 9.80665 * 2.0 * 4.0  # weight in N for each mm of length
    assert tip[1] == pytest.approx(-weight * 50.0**4 / (8 * 3 * 0.05 * 4.0 * 8 / 12), rel=0.005)


def test_in_plane_strain_the_mooney_rivlin_beam_depends_only_on_the_sum_of_its_parameters():
    specimen, field = magnet_tipped()
    model = BeamModel(specimen, 26, 2)
    c10 = np.array([0.0, 0.01, 0.02, 0.025]) * 1e6
    shapes = model.solve(
        LAWS["mooney-rivlin"], np.column_stack([c10, 0.025e6 - c10]), Loads.along(np.linspace(0, field, 6))
    )
    tips = model.positions(shapes, np.array([[30.0, 0.0]]))[:, -1, 0]
    assert np.ptp(tips, axis=0).max() < 1e-3


def test_a_candidate_does_not_depend_on_the_other_candidates():
    specimen, field = magnet_tipped()
    model = BeamModel(specimen)
    loads = Loads.along(np.linspace(0, field, 5))
    alone = model.solve(NEO, MU, loads)
    crowd = np.array([[1.0], [np.nan], [0.05e6], [-3.0], [1e10], [np.inf], [0.0]])
    together = model.solve(NEO, crowd, loads)
    assert together.displacement[2] == pytest.approx(alone.displacement[0], abs=1e-7)
    assert together.converged.tolist()[1:4] == [False, True, False]
    assert not together.converged[5:].any()
    assert np.isfinite(together.displacement).all()
    assert np.isfinite(together.max_stretch).all()


def test_planar_and_solid_models_can_be_pickled():
    loads = Loads.along(np.array([2.0]))
    specimen, _ = magnet_tipped()
    for model in (BeamModel(specimen, 6, 1), SolidModel(specimen, 6, 1), SolidBeside(specimen, 6, 1)):
        sent = pickle.loads(on_the_way := pickle.dumps(model))
        assert len(on_the_way) < 1000
        assert (sent.solve(NEO, MU, loads).displacement == model.solve(NEO, MU, loads).displacement).all()


def test_loads_without_equilibrium_give_a_status():
    specimen, field = magnet_tipped()
    model = BeamModel(specimen)
    shapes = model.solve(NEO, np.array([[1.0], [0.05e6]]), Loads.along([0.0, 1e6 * field]))
    assert set(np.unique(shapes.status)) <= {int(s) for s in Status}
    assert np.isfinite(shapes.displacement).all()


def test_a_state_does_not_depend_on_the_states_before():
    specimen, field = magnet_tipped(0.2)
    model = BeamModel(specimen)
    stepped = model.solve(NEO, MU, Loads.along(np.linspace(0, field, 16)), tolerance_mm=1e-8)
    direct = model.solve(NEO, MU, Loads.along(field), tolerance_mm=1e-8)
    assert direct.displacement[0, 0] == pytest.approx(stepped.displacement[0, -1], abs=1e-6)


@pytest.mark.parametrize("tolerance_mm", [1e-2, 1e-4, 1e-6])
def test_the_position_of_every_node_is_within_the_tolerance(tolerance_mm):
    specimen, field = magnet_tipped(0.2)
    model = BeamModel(specimen)
    for loads in (Loads.along(0.5 * field), Loads.along(field * np.array([0.3, 0.6, 1.0]))):
        exact = model.solve(NEO, MU, loads, tolerance_mm=1e-10)
        ours = model.solve(NEO, MU, loads, tolerance_mm=tolerance_mm)
        assert exact.converged[0]
        assert np.abs(ours.displacement - exact.displacement).max() < tolerance_mm


def test_a_reversed_field_mirrors_the_beam():
    specimen, field = magnet_tipped(0.2)
    model = BeamModel(specimen)
    shapes = model.solve(NEO, MU, Loads.along([field, -field]), tolerance_mm=1e-8)
    angle = model.tip_angle_deg(shapes)[0]
    assert angle[0] == pytest.approx(-angle[1], rel=1e-6)
    assert angle[0] > 0


def test_the_tip_never_turns_beyond_the_direction_of_the_field():
    specimen, field = magnet_tipped()
    model = BeamModel(specimen)
    shapes = model.solve(NEO, np.array([[5e3]]), Loads.along(field * np.linspace(0, 10, 20), gravity_angle_deg=None))
    angle = model.tip_angle_deg(shapes)[0][shapes.status[0] == Status.CONVERGED]
    assert len(angle) == 20
    assert np.all(np.diff(angle) > 0)
    assert angle[-1] < 90


def test_points_outside_the_beam_are_refused():
    model = BeamModel(Specimen(100.0, 30.0, 30.0, 1070.0, "plane-stress"))
    with pytest.raises(ValueError, match=r"point \(101, 9\) mm is not on the specimen"):
        model.place(np.array([[50.0, 0.0], [101.0, 9.0]]))


def test_a_magnet_as_long_as_the_beam_is_refused():
    with pytest.raises(ValueError, match="no flexible part is left"):
        BeamModel(Specimen(4.0, 3.0, 1.0, 1070.0, "plane-strain", Magnet(4.0, 3.0, 1.0, 1.0, 7500.0)))


def test_a_law_that_is_unstable_at_a_reached_stretch_is_reported():
    specimen, field = magnet_tipped()
    model = BeamModel(specimen)
    loads = Loads.along([0.0, 0.3 * field, field])
    shapes = model.solve(LAWS["yeoh"], np.array([[25e3, 0, 0], [25e3, -1e5, 0]]), loads)
    assert shapes.status[0].tolist() == [Status.CONVERGED] * 3
    assert shapes.status[1].tolist() == [Status.CONVERGED, Status.CONVERGED, Status.UNSTABLE]


def test_a_finite_bulk_modulus_softens_the_beam_and_a_large_one_does_not():
    specimen, field = magnet_tipped()
    model = BeamModel(specimen)
    loads = Loads.along([0.02 * field], gravity_angle_deg=None)
    shapes = model.solve(NEO, np.array([[0.05e6]] * 2), loads, bulk_modulus_Pa=np.array([0.1e6, 500e6]))
    soft, hard = shapes.rigid[:, 0, 2]
    reference = model.solve(NEO, MU, loads).rigid[0, 0, 2]
    assert hard == pytest.approx(reference, rel=1e-4)
    # In plane strain E' = 9 K mu / (3 K + mu) / (1 - nu^2); small angles are proportional to 1 / E'.
    k, mu = 0.1, 0.05
    nu = (3 * k - 2 * mu) / (2 * (3 * k + mu))
    stiffness = 9 * k * mu / (3 * k + mu) / (1 - nu**2)
    assert soft / reference == pytest.approx(4 * mu / stiffness, rel=0.02)


def test_plane_stress_takes_no_bulk_modulus():
    model = BeamModel(Specimen(50.0, 2.0, 4.0, 1.0, "plane-stress"))
    with pytest.raises(ValueError, match="plane stress"):
        model.solve(NEO, MU, Loads.along(0.0), bulk_modulus_Pa=np.array([1e6]))


@pytest.mark.parametrize("magnetisation", [(0.0, 0.0), (6e4, -2e4)])
def test_a_field_factor_has_the_effect_of_a_stronger_field(magnetisation):
    specimen, field = magnet_tipped(0.2)
    model = BeamModel(replace(specimen, magnetisation_A_per_m=magnetisation))
    factors = np.array([1.0, 0.7, 1.2, -1.0, 0.0])
    together = model.solve(
        NEO, np.tile(MU, (5, 1)), Loads.along(np.linspace(0, field, 4)), tolerance_mm=1e-8, field_factor=factors
    )
    for k, factor in enumerate(factors):
        alone = model.solve(NEO, MU, Loads.along(np.linspace(0, factor * field, 4)), tolerance_mm=1e-8)
        assert alone.converged.all()
        assert together.displacement[k] == pytest.approx(alone.displacement[0], abs=1e-7)
        assert together.rigid[k] == pytest.approx(alone.rigid[0], abs=1e-8)


def test_a_field_factor_of_nan_gives_a_status():
    specimen, field = magnet_tipped()
    model, loads = BeamModel(specimen), Loads.along(np.linspace(0, field, 4))
    shapes = model.solve(NEO, np.tile(MU, (4, 1)), loads, field_factor=np.array([np.nan, 1.0, np.inf, -np.inf]))
    assert shapes.converged.tolist() == [False, True, False, False]
    assert np.all(shapes.status[[0, 2, 3]] == Status.DIVERGED)
    assert shapes.displacement[1] == pytest.approx(model.solve(NEO, MU, loads).displacement[0], abs=1e-7)
    assert np.isfinite(shapes.displacement).all()


def test_a_finer_model_has_elements_of_half_the_length():
    model = BeamModel(Specimen(30.0, 3.0, 5.0, 1070.0, "plane-strain", Magnet(4.0, 3.0, 2.0, 1.2, 7500.0)))
    lengths = [
        np.diff(np.unique(each.mesh.nodes[:, 0].round(9))).min() for each in (model, model.refined(), model.halved())
    ]
    assert lengths[1:] == pytest.approx([lengths[0] / 2] * 2, rel=0.1)
    nodes = [len(each.mesh.nodes) for each in (model, model.refined(), model.halved())]
    assert nodes[1] > nodes[2] > 3 * nodes[0]
