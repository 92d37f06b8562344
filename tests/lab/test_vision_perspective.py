"""With an ordinary lens, a fit gives the right modulus only if it takes the perspective of the lens into account."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.outline import outline
from eimi_fitting.beam.view import View
from eimi_fitting.inference.evidence.measurements import EdgeObservation, signed_distance
from eimi_fitting.laws import LAWS
from eimi_lab.config.materials import TrueMaterial
from eimi_lab.virtual.beam import VirtualBeam, VirtualLoads
from eimi_lab.virtual.optics import expose, make_scene
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.edges.finding import find_edges
from tests.shared.rendered_edges import CALIBRATION, NOMINAL, SIZE, SPECIMEN

TRUE_PA = 50e3
FIELDS_MT = (0.0, 3.0, 6.0)
MESH = (13, 2)  # virtual beam and fit have the same mesh, so that only the outlines differ
CLAMP = [[0.0, -8.0], [0.0, 8.0], [-15.0, 8.0], [-15.0, -8.0]]


def photographed_edges(calibration):
    # Return the edges of a virtual beam in rendered frames at several fields, and the perspective of the lens.
    frame, specimen = BeamFrame(calibration), SPECIMEN.mechanics()
    material = TrueMaterial(model="neo-hookean", parameters={"mu_Pa": TRUE_PA})
    view = frame.view(specimen.depth_mm, SIZE)
    beam = VirtualBeam(
        specimen, material, (*MESH, 1), VirtualLoads(frame.gravity_deg, frame.field_deg), max(FIELDS_MT), view
    )
    edges = []
    for field in FIELDS_MT:
        outline_mm, _ = beam.outlines_mm(field)
        scene = make_scene(NOMINAL, SIZE, frame.to_px(outline_mm), None, frame.to_px(CLAMP), 2)
        edge_set = find_edges(expose(scene, np.random.default_rng(1)), calibration, SPECIMEN)
        edges.append(
            (edge_set.left.points_mm, edge_set.left.sigma_mm, edge_set.right.points_mm, edge_set.right.sigma_mm)
        )
    return edges, view


def fitted(edges, view):
    # Return the shear modulus (Pa) with the smallest error of the edges, and this error (mm).
    # view: the perspective of the lens, or None.
    frame, model = BeamFrame(CALIBRATION), SolidBeside(SPECIMEN.mechanics(), *MESH)
    loads = Loads.along(list(FIELDS_MT), frame.field_deg, frame.gravity_deg)
    observation = EdgeObservation.from_edges(edges, view)

    def error(logarithm):
        shapes = model.solve(LAWS["neo-hookean"], np.array([[np.exp(logarithm)]]), loads)
        return float(observation.misfit(model, shapes).error_mm.mean())

    best = minimize_scalar(
        error, bounds=np.log([0.7 * TRUE_PA, 1.4 * TRUE_PA]), method="bounded", options={"xatol": 5e-4}
    )
    return float(np.exp(best.x)), float(best.fun)


def test_the_modulus_is_right_only_with_the_outlines_of_both_faces():
    calibration = CALIBRATION.model_copy(update={"stand_off_mm": 150.0})
    edges, view = photographed_edges(calibration)
    without, error_without = fitted(edges, None)
    with_both, error_with = fitted(edges, view)
    print(f"bias without {100 * (without / TRUE_PA - 1):+.2f} %, with {100 * (with_both / TRUE_PA - 1):+.2f} %")
    print(f"error without {1e3 * error_without:.1f} um, with {1e3 * error_with:.1f} um")
    assert abs(with_both / TRUE_PA - 1) < 0.003
    assert abs(without / TRUE_PA - 1) > 2 * abs(with_both / TRUE_PA - 1)
    assert error_with < 0.2 * error_without


@pytest.mark.parametrize("centre", [(10.0, 1.0), (10.0, -20.0)], ids=["before it", "aside"])
def test_the_outline_of_a_flat_section_is_that_of_its_outer_face(centre):
    model = BeamModel(SPECIMEN.mechanics(), *MESH, "plane-stress")
    shapes = model.solve(LAWS["neo-hookean"], np.array([[TRUE_PA]]), Loads.along([0.0, 4.0]))
    flat, projected = outline(model, shapes)[0], outline(model, shapes, View(np.array(centre), 100.0))[0]
    depth = model.specimen.depth_mm
    faces = [np.array(centre) + 100 / (100 + z) * (flat - np.array(centre)) for z in (-depth / 2, depth / 2)]
    for k in range(2):
        for side, sign in ((0, -1), (1, 1)):
            points = projected[k, side, 1:-4, 1]
            out = sign * np.stack([signed_distance(face[k, side], points) for face in faces])
            assert out.min(axis=0) == pytest.approx(0, abs=2e-3)


def test_a_calibration_without_a_stand_off_has_no_view():
    assert BeamFrame(CALIBRATION).view(5.0, SIZE) is None
    with pytest.raises(ValueError, match="should be more than half of depth_mm"):
        BeamFrame(CALIBRATION.model_copy(update={"stand_off_mm": 2.0})).view(5.0, SIZE)
