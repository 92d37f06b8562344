"""Derivatives of the edges with respect to parameters and loads agree with finite differences and with physics."""

from __future__ import annotations

import numpy as np
import pytest

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.specimen import Magnet, Specimen
from eimi_fitting.inference.evidence.measurements import edge_curves, points_on
from eimi_fitting.inference.planning.sensitivity import edge_sensitivity
from eimi_fitting.laws import LAWS, Law

SPECIMEN = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-strain", Magnet(4.0, 3.0, 2.0, 1.2, 7500.0))
LOADS = Loads.along([0.0, 3.5, 7.05])
CANDIDATES = {
    "neo-hookean": [[46e3]],
    "mooney-rivlin": [[18e3, 5e3], [23e3, 0.0]],
    "yeoh": [[23e3, 5e3, 0.0], [30e3, -2e3, 100.0]],
    "ogden": [[2e4, 1.7, 100.0, 8.0, -5e3, -2.5]],
}


def edges_of(model: BeamModel, law: Law, parameters: np.ndarray, loads: Loads) -> np.ndarray:
    # Return points of the edges (x, y) in mm, shape (K, 2, m, 2): K load steps, two edges, m points.
    return points_on(edge_curves(model, model.solve(law, parameters[None], loads, tolerance_mm=1e-9)), 2)[0]


def derivative(function, size: float) -> np.ndarray:
    # Return the derivative of `function` at zero by differences of fourth order with the step ``size``.
    near, far = (function(k * size) - function(-k * size) for k in (1, 2))
    return (8 * near - far) / (12 * size)


@pytest.mark.parametrize("name", CANDIDATES)
def test_the_derivative_agrees_with_curves_solved_separately(name):
    # Differences of fourth order with steps a hundred times larger are independent of the tested code.
    model, law, candidates = BeamModel(SPECIMEN), LAWS[name], np.array(CANDIDATES[name])
    sensitivity = edge_sensitivity(model, law, candidates, LOADS)
    assert sensitivity.converged.all()
    for candidate, edges, slopes in zip(candidates, sensitivity.edges, sensitivity.slope, strict=True):
        assert edges == pytest.approx(edges_of(model, law, candidate, LOADS), abs=1e-7)
        modulus = law.initial_shear_modulus(candidate)
        for i, unit in enumerate(law.units):
            step = 0.01 * (abs(candidate[i]) or (1.0 if unit == "1" else modulus)) * np.eye(len(candidate))[i]
            wide = derivative(lambda h, c=candidate, s=step: edges_of(model, law, c + h * s, LOADS), 1.0) / step.max()
            assert slopes[i] == pytest.approx(wide, abs=1e-3 * np.abs(wide).max())


def test_stiffness_and_field_have_opposite_effects():
    # Without gravity only field over modulus matters: mu d(edges)/d(mu) = -B d(edges)/dB.
    model, law, mu, field = BeamModel(SPECIMEN), LAWS["neo-hookean"], np.array([46e3]), np.array([2.0, 4.5, 7.05])
    sensitivity = edge_sensitivity(model, law, mu, Loads.along(field, gravity_angle_deg=None))
    by_field = derivative(
        lambda h: edges_of(model, law, mu, Loads.along((1 + h) * field, gravity_angle_deg=None)), 1e-3
    )
    assert mu * sensitivity.slope[0, 0] == pytest.approx(-by_field, rel=1e-5, abs=1e-5)


def test_a_stiffer_beam_bends_less_and_both_mooney_rivlin_terms_have_the_same_effect():
    model = BeamModel(SPECIMEN, 26, 2)
    sensitivity = edge_sensitivity(model, LAWS["mooney-rivlin"], np.array([18e3, 5e3]), LOADS)
    slope = sensitivity.slope[0]
    assert sensitivity.edges.shape == (1, *slope.shape[1:])
    assert np.all(slope[:, 1:, :, -1, 1] < 0)  # deflection of the tip in the field
    assert slope[0] == pytest.approx(slope[1], abs=5e-3 * np.abs(slope).max())


def test_a_candidate_without_equilibrium_is_marked_and_affects_no_other():
    model, law = BeamModel(SPECIMEN), LAWS["neo-hookean"]
    sensitivity = edge_sensitivity(model, law, np.array([[46e3], [-1.0], [np.nan]]), LOADS)
    assert sensitivity.converged.tolist() == [True, False, False]
    alone = edge_sensitivity(model, law, np.array([46e3]), LOADS)
    assert sensitivity.slope[0] == pytest.approx(alone.slope[0], rel=1e-9)
