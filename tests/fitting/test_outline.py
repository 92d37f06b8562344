"""The computed outline of a bent solid, as a camera sees it, encloses the solid and touches its faces."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.outline import edge_curves, outline, points_on
from eimi_fitting.beam.path import Shapes
from eimi_fitting.beam.solid_model import SolidModel
from eimi_fitting.beam.specimen import Magnet, Specimen
from eimi_fitting.beam.view import View
from eimi_fitting.inference.evidence.measurements import signed_distance
from eimi_fitting.laws import LAWS
from tests.shared.solid_cases import MAGNETIC, held

NEO, MODULUS = LAWS["neo-hookean"], np.array([4.6e4])
BEAMS = {
    "a magnet in part of the depth": Specimen(
        30.0, 3.0, 5.0, 1070.0, "plane-stress", Magnet(4.0, 3.0, 2.0, 1.2, 7500.0)
    ),
    "deep": Specimen(30.0, 3.0, 9.0, 1070.0, "plane-stress", Magnet(4.0, 3.0, 9.0, 0.48, 7500.0)),
}
VIEWS = {
    "telecentric": None,
    "150 mm": View(np.array([15.0, 10.0]), 150.0),
    "aside": View(np.array([5.0, -30.0]), 300.0),
}
LOADS = Loads.along([3.0, 6.0])


@lru_cache
def bent(beam: str) -> tuple[SolidModel, Shapes]:
    # Return the three-dimensional model of a beam, and its shapes under the loads.
    model = SolidModel(BEAMS[beam], 20, 2)
    return model, model.solve(NEO, MODULUS, LOADS)


@pytest.mark.parametrize("beam", BEAMS)
@pytest.mark.parametrize(
    "view", ["aside", *(pytest.param(view, marks=pytest.mark.slow) for view in ("telecentric", "150 mm"))]
)
def test_the_faces_lie_within_the_outline_and_touch_it(beam, view):
    specimen, camera = BEAMS[beam], VIEWS[view]
    model, shapes = bent(beam)
    assert shapes.converged[0]
    curves = outline(model, shapes, camera)[0]  # (K, 2, S, 3, 2)
    x = np.linspace(1.0, 25.5, 60)
    z = np.linspace(-0.5, 0.5, 41) * specimen.depth_mm
    for side, y in enumerate((-1.5, 1.5)):
        points = np.stack(np.broadcast_arrays(x[:, None], y, z), axis=-1)
        places = model.positions(shapes, points.reshape(-1, 3))[0]
        image = places[..., :2] if camera is None else camera.seen(places)
        out = signed_distance(curves[:, side], image).reshape(2, 60, 41) * (-1 if side == 0 else 1)
        assert out[:, :-1].max() < 1.5e-3  # quadratic segments approximate the envelope to this accuracy
        assert out.max() < 6e-3  # the last point is beside the magnet, where the curvature of the beam has a step
        assert out.max(axis=2).min() > -1.5e-3


def test_the_convex_edge_is_that_of_the_outer_faces_and_the_concave_edge_that_of_the_middle_plane():
    model, shapes = bent("a magnet in part of the depth")
    curves = outline(model, shapes)[0, -1]
    middle, face = (
        model.positions(shapes, np.array([[13.0, y, z] for y in (-1.5, 1.5)]))[0, -1, :, :2] for z in (0, 2.5)
    )
    # The tip turns toward y > 0: the right edge is the concave one.
    off_middle = np.array([signed_distance(curves[s], middle[s : s + 1])[0] for s in (0, 1)])
    off_face = np.array([signed_distance(curves[s], face[s : s + 1])[0] for s in (0, 1)])
    assert off_middle[1] == pytest.approx(0, abs=1e-3)
    assert off_face[0] == pytest.approx(0, abs=1e-3)
    assert off_middle[0] > 0.02  # inside by the bow of the section, about curvature times depth² over 16
    assert off_face[1] < -0.02


def test_the_outline_in_plane_strain_is_the_edge_of_the_planar_model():
    flat, solid = BeamModel(MAGNETIC, 8, 1), held(MAGNETIC, 8, 1)
    one = edge_curves(flat, flat.solve(NEO, MODULUS, LOADS, tolerance_mm=1e-8))
    shapes = solid.solve(NEO, MODULUS, LOADS, tolerance_mm=1e-8)
    assert outline(solid, shapes) == pytest.approx(one, abs=1e-6)
    # A flat section in perspective: at each point the outline is the outer one of both faces.
    camera = VIEWS["aside"]
    image = outline(solid, shapes, camera)[0, -1]
    faces = [camera.centre_mm + 300 / (300 + z) * (one[0, -1] - camera.centre_mm) for z in (-2.5, 2.5)]
    for side, sign in ((0, -1), (1, 1)):
        points = points_on(image[side], 2)[2:-8]
        out = sign * np.stack([signed_distance(face[side], points) for face in faces])
        assert out.min(axis=0) == pytest.approx(0, abs=2e-3)


@pytest.mark.parametrize("solid", [False, True])
def test_an_outline_goes_forward_where_it_changes_from_the_near_to_the_far_face(solid: bool) -> None:
    # The lens is very near: in the picture, the near and far face of one cross-section are farther apart than two
    # neighbouring cross-sections.
    specimen = replace(BEAMS["deep"], magnet=None)
    model = SolidModel(specimen, 20, 2) if solid else BeamModel(specimen, 20, 2)
    force = np.array([0.02, 0.03])
    shapes = model.solve(NEO, np.array([1.5e5]), Loads.along(np.zeros(2), gravity_angle_deg=90.0, tip_force_N=force))
    assert shapes.converged.all()
    camera = View(np.array([15.0, 4.0]), 150.0)
    lines = points_on(outline(model, shapes, camera)[0], 4)
    step = np.diff(lines, axis=-2)
    turn = np.arctan2(step[..., 1], step[..., 0])
    assert np.abs(np.diff(turn)).max() < 0.12  # rad: the near and the far face cross at a small angle
    x, z = np.linspace(2.0, 28.0, 80), np.array([-0.5, 0.0, 0.5]) * specimen.depth_mm
    for side, y in enumerate((-1.5, 1.5)):
        if solid:
            points = np.stack(np.broadcast_arrays(x[:, None], y, z), axis=-1).reshape(-1, 3)
            places = model.positions(shapes, points)[0]
        else:
            flat = model.positions(shapes, np.column_stack([x, np.full(80, y)]))[0]
            places = np.concatenate(
                [np.repeat(flat, 3, axis=1), np.broadcast_to(np.tile(z, 80)[None, :, None], (2, 240, 1))], axis=2
            )
        image = camera.seen(places)
        out = signed_distance(outline(model, shapes, camera)[0, :, side], image).reshape(2, 80, 3) * (2 * side - 1)
        assert out.max() < 3e-3


def test_a_pupil_within_the_specimen_is_refused():
    model = SolidModel(replace(MAGNETIC, magnet=None), 4, 1)
    shapes = model.solve(NEO, MODULUS, LOADS)
    with pytest.raises(ValueError, match="stand_off_mm = 2 lies inside"):
        outline(model, shapes, View(np.zeros(2), 2.0))
