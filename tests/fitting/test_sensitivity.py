"""Sensitivities against another step and against what the physics says."""

from __future__ import annotations

import numpy as np
import pytest

from eimi_fitting.actuation import Loads
from eimi_fitting.forward import BeamModel
from eimi_fitting.materials import LAWS
from eimi_fitting.sensitivity import edge_sensitivity
from eimi_fitting.specimen import Magnet, Specimen

SPECIMEN = Specimen(30.0, 3.0, 5.0, 1070.0, "plane-strain", Magnet(4.0, 3.0, 2.0, 1.2, 7500.0))
LOADS = Loads.along([0.0, 3.5, 7.05])


@pytest.mark.parametrize(
    ("name", "parameters"),
    [("yeoh", [23e3, 5e3, 0.0]), ("ogden", [2e4, 1.7, 100.0, 8.0, -5e3, -2.5])],
)
def test_the_derivative_does_not_depend_on_the_step(name, parameters):
    model, law = BeamModel(SPECIMEN), LAWS[name]
    _, fine = edge_sensitivity(model, law, np.array(parameters), LOADS, 1e-4)
    _, coarse = edge_sensitivity(model, law, np.array(parameters), LOADS, 1e-3)
    for one, other in zip(fine, coarse, strict=True):
        assert one == pytest.approx(other, abs=1e-3 * np.abs(one).max())


def test_a_stiffer_beam_bends_less_and_both_halves_of_mooney_rivlin_count_the_same():
    model = BeamModel(SPECIMEN, 26, 2)
    edges, slope = edge_sensitivity(model, LAWS["mooney-rivlin"], np.array([18e3, 5e3]), LOADS)
    assert edges.shape == slope.shape[1:]
    assert np.all(slope[:, 1:, :, -1, 1] < 0)  # the tip's deflection in the field
    assert slope[0] == pytest.approx(slope[1], abs=5e-3 * np.abs(slope).max())


def test_no_equilibrium_is_an_error():
    with pytest.raises(ArithmeticError, match="no equilibrium"):
        edge_sensitivity(BeamModel(SPECIMEN), LAWS["neo-hookean"], np.array([-1.0]), LOADS)
