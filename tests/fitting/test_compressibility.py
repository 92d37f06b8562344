"""The bending of a beam of compressible silicone agrees with beam theory."""

from dataclasses import replace

import pytest

from eimi_fitting import Magnet, Specimen
from eimi_fitting.inference.planning.compressibility import bulk_ratio, compressibility_bias

BEAM = Specimen(30.0, 2.0, 3.0, 1070.0, "solid", Magnet(4.0, 2.0, 3.0, 0.5, 7500.0))


def test_a_slender_solid_bends_according_to_its_youngs_modulus():
    young = 2 * (1 + 0.45) / 3  # Young's modulus over that of an incompressible material with the same shear modulus
    assert compressibility_bias(BEAM, 0.45) == pytest.approx(young - 1, abs=0.008)


def test_plane_strain_bends_according_to_youngs_modulus_over_one_minus_the_squared_ratio():
    expected = (1 + 0.45) / (1 - 0.45**2) / (1.5 / 0.75)
    assert compressibility_bias(replace(BEAM, section="plane-strain"), 0.45) == pytest.approx(expected - 1, abs=0.01)


def test_the_bulk_modulus_is_that_of_linear_elasticity():
    assert bulk_ratio(0.25) == pytest.approx(5 / 3)
