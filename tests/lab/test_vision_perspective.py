"""A specimen with depth before an ordinary lens: what its near and far outlines do to a fitted modulus."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from eimi_fitting.actuation import Loads
from eimi_fitting.forward import BeamModel
from eimi_fitting.materials import LAWS
from eimi_fitting.observation import EdgeObservation, Perspective
from eimi_lab.config.materials import TrueMaterial
from eimi_lab.virtual.beam import VirtualBeam
from eimi_lab.virtual.optics import expose, make_scene
from eimi_lab.vision.beam_frame import BeamFrame
from eimi_lab.vision.benchmark import CALIBRATION, NOMINAL, SIZE, SPECIMEN
from eimi_lab.vision.edges import find_edges

TRUE_PA = 50e3
FIELDS_MT = (0.0, 3.0, 6.0)
MESH = (13, 2)  # of both, so that the two outlines alone make a difference
CLAMP = [[0.0, -8.0], [0.0, 8.0], [-15.0, 8.0], [-15.0, -8.0]]


def photographed_edges(calibration):
    """Edges of rendered frames of a virtual beam, seen by the calibration's lens."""
    frame, specimen = BeamFrame(calibration), SPECIMEN.mechanics()
    material = TrueMaterial(model="neo-hookean", parameters={"mu_Pa": TRUE_PA})
    beam = VirtualBeam(specimen, material, MESH, frame.gravity_deg, frame.field_deg)
    perspective = frame.perspective(specimen.depth_mm, SIZE)
    edges = []
    for field in FIELDS_MT:
        outline, _ = beam.outlines_mm(field)
        near, far = perspective.faces(outline) if perspective else (outline, outline)
        clamp = frame.to_px(CLAMP)
        scene = make_scene(NOMINAL, SIZE, frame.to_px(near), None, clamp, 2, far_px=frame.to_px(far))
        found = find_edges(expose(scene, np.random.default_rng(1)), calibration, SPECIMEN)
        edges.append((found.left.points_mm, found.left.sigma_mm, found.right.points_mm, found.right.sigma_mm))
    return edges, perspective


def fitted(edges, perspective):
    """Shear modulus (Pa) with the least mean error, and that error (mm)."""
    frame, model = BeamFrame(CALIBRATION), BeamModel(SPECIMEN.mechanics(), *MESH)
    loads = Loads.along(list(FIELDS_MT), frame.field_deg, frame.gravity_deg)
    observation = EdgeObservation.from_edges(edges, perspective)

    def error(logarithm):
        shapes = model.solve(LAWS["neo-hookean"], np.array([[np.exp(logarithm)]]), loads)
        return float(observation.misfit(model, shapes).error_mm.mean())

    best = minimize_scalar(
        error, bounds=np.log([0.7 * TRUE_PA, 1.4 * TRUE_PA]), method="bounded", options={"xatol": 1e-4}
    )
    return float(np.exp(best.x)), float(best.fun)


def test_the_modulus_with_and_without_the_outlines_of_both_faces():
    calibration = CALIBRATION.model_copy(update={"stand_off_mm": 150.0})
    edges, perspective = photographed_edges(calibration)
    without, error_without = fitted(edges, None)
    with_both, error_with = fitted(edges, perspective)
    print(f"bias without {100 * (without / TRUE_PA - 1):+.2f} %, with {100 * (with_both / TRUE_PA - 1):+.2f} %")
    print(f"error without {1e3 * error_without:.1f} um, with {1e3 * error_with:.1f} um")
    assert abs(with_both / TRUE_PA - 1) < 0.003
    assert abs(without / TRUE_PA - 1) > 2 * abs(with_both / TRUE_PA - 1)
    assert error_with < 0.2 * error_without


def test_the_union_is_farther_out_than_either_face():
    perspective = Perspective(np.array([10.0, 1.0]), 100.0, 5.0)
    x = np.linspace(0.0, 30.0, 31)
    sides = [
        np.stack([x[:-2:2], np.full(15, y), x[1:-1:2], np.full(15, y), x[2::2], np.full(15, y)], 1) for y in (-2.0, 2.0)
    ]
    curves = np.stack(sides).reshape(2, 15, 3, 2)
    near, far = perspective.faces(np.array([[10.0, -2.0], [10.0, 2.0]]))
    assert near[:, 1] == pytest.approx([1 - 3 / 0.975, 1 + 1 / 0.975])
    points = np.array([[[10.0, near[0, 1]]], [[10.0, max(near[1, 1], far[1, 1])]]])
    assert perspective.distance_to_union(curves, points) == pytest.approx(np.zeros((2, 1)), abs=1e-12)
    # A beam wholly to one side of the axis: one edge is the near face's, the other the far one's.
    aside = Perspective(np.array([10.0, -20.0]), 100.0, 5.0)
    near, far = aside.faces(np.array([[10.0, -2.0], [10.0, 2.0]]))
    points = np.array([[[10.0, far[0, 1]]], [[10.0, near[1, 1]]]])
    assert aside.distance_to_union(curves, points) == pytest.approx(np.zeros((2, 1)), abs=1e-12)


def test_no_perspective_where_none_is_known():
    assert BeamFrame(CALIBRATION).perspective(5.0, SIZE) is None
    with pytest.raises(ValueError, match="within the depth"):
        BeamFrame(CALIBRATION.model_copy(update={"stand_off_mm": 2.0})).perspective(5.0, SIZE)
