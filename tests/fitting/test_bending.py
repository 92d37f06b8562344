"""`Beam(specimen).solve` computes the shapes of a beam for one or several sets of parameters of a law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eimi_fitting import LAWS, Beam, BeamModel, Loads, Magnet, Specimen
from eimi_fitting.beam.equilibrium import Status
from eimi_fitting.beam.solid_model import SolidModel

BEAM = Specimen(30.0, 3.0, 5.0, 1070.0, "solid", Magnet(4.0, 3.0, 5.0, 0.48, 7500.0))
LOADS = Loads.along([0.0, 3.0])


def test_a_solid_specimen_is_solved_as_a_solid():
    bent = Beam(BEAM, 8, 1).solve("neo-hookean", [46e3], LOADS)
    model = SolidModel(BEAM, 8, 1)
    shapes = model.solve(LAWS["neo-hookean"], np.array([[46e3]]), LOADS)
    assert bent.tip_angle_deg == pytest.approx(model.tip_angle_deg(shapes)[0], rel=1e-9)
    points = np.array([[15.0, 1.5, 0.0], [30.0, 0.0, 0.0]])
    assert bent.positions(points) == pytest.approx(model.positions(shapes, points)[0], rel=1e-9)
    assert bent.positions(points[:, :2]) == pytest.approx(bent.positions(points)[..., :2])
    assert bent.max_stretch == pytest.approx(shapes.max_stretch[0], rel=1e-9)
    assert bent.edges().shape[:2] == (2, 2)


def test_the_section_of_a_specimen_selects_its_model():
    specimen = replace(BEAM, magnet=Magnet(4.0, 3.0, 2.0, 1.2, 7500.0))
    loads = Loads.along([4.0])
    as_solid = Beam(specimen, 13, 2).solve("neo-hookean", [46e3], loads)
    as_plane = Beam(replace(specimen, section="plane-stress")).solve("neo-hookean", [46e3], loads)
    assert as_solid.tip_angle_deg[0] == pytest.approx(43.93, abs=0.02)
    assert as_plane.tip_angle_deg[0] == pytest.approx(43.71, abs=0.005)


@pytest.mark.parametrize("section", ["plane-stress", "solid"])
def test_parameters_give_the_same_shape_alone_and_among_others(section):
    beam = Beam(replace(BEAM, section=section), 8, 1)
    many = beam.solve(LAWS["neo-hookean"], [[40e3], [46e3]], LOADS, field_factor=[1.0, 1.05])
    one = beam.solve("neo-hookean", [46e3], LOADS, field_factor=1.05)
    assert many.converged.tolist() == [True, True]
    assert one.converged is True
    assert one.status.tolist() == [Status.CONVERGED] * 2
    for of_one, of_many in (
        (one.tip_angle_deg, many.tip_angle_deg),
        (one.max_stretch, many.max_stretch),
        (one.positions([[20.0, 1.0]]), many.positions([[20.0, 1.0]])),
        (one.outline(), many.outline()),
    ):
        assert of_one == pytest.approx(of_many[1], rel=1e-9)


def test_a_state_without_equilibrium_has_no_shape():
    beam = Beam(replace(BEAM, section="plane-stress"), 4, 1)
    bent = beam.solve("neo-hookean", [[46e3], [-1.0]], LOADS)
    assert bent.converged.tolist() == [True, False]
    assert np.isnan(bent.tip_angle_deg[1]).all()
    assert np.isnan(bent.edges()[1]).all()
    assert np.isfinite(bent.edges()[0]).all()


def test_a_wrong_name_of_a_law_and_a_wrong_number_of_parameters_are_refused():
    beam = Beam(replace(BEAM, section="plane-stress"), 4, 1)
    with pytest.raises(KeyError, match="did you mean 'neo-hookean'"):
        beam.solve("neohookean", [46e3], LOADS)
    with pytest.raises(ValueError, match=r"the law yeoh needs the shape \(3,\) or \(P, 3\)"):
        beam.solve("yeoh", [46e3], LOADS)


def test_a_point_in_depth_is_refused_in_a_plane():
    bent = Beam(replace(BEAM, section="plane-stress"), 4, 1).solve("neo-hookean", [46e3], LOADS)
    with pytest.raises(ValueError, match="needs points of shape \\(n, 2\\)"):
        bent.positions([[1.0, 0.0, 1.0]])


def test_a_planar_model_of_a_solid_specimen_needs_the_name_of_its_plane():
    with pytest.raises(ValueError, match="use Beam"):
        BeamModel(BEAM)
    named = BeamModel(BEAM, plane="plane-stress")
    stated = BeamModel(replace(BEAM, section="plane-stress"))
    law, parameters = LAWS["neo-hookean"], np.array([[46e3]])
    angles = [model.tip_angle_deg(model.solve(law, parameters, LOADS)) for model in (named, stated)]
    assert angles[0] == pytest.approx(angles[1], rel=1e-12)
    assert named.refined().plane == "plane-stress"
