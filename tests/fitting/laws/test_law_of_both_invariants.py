"""A user's law in I1 and I2 has the right derivatives in plane strain and plane stress."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from eimi_fitting.laws.invariants import InvariantLaw
from eimi_fitting.laws.law import Coordinate


@dataclass(frozen=True)
class Both(InvariantLaw):
    # The law W = a x + b x² + c y with x = I1 - 3 and y = I2 - 3.

    name: str = "both"
    formula: str = "W = a (I1 - 3) + b (I1 - 3)^2 + c (I2 - 3)"
    parameter_names: tuple[str, ...] = ("a", "b", "c")
    units: tuple[str, ...] = ("Pa", "Pa", "Pa")
    coordinates: tuple[Coordinate, ...] = (Coordinate("mu", 1e3, 1e6),)
    needs_second = True

    def from_coordinates(self, x):
        return x

    def initial_shear_modulus(self, parameters):
        return 2 * (parameters[..., 0] + parameters[..., 2])

    def coefficients(self, parameters, x, y):
        a, b, c = np.moveaxis(parameters, -1, 0)
        return a * x + b * x**2 + c * y, a + 2 * b * x, c + 0 * x, 2 * b + 0 * x


@pytest.mark.parametrize("section", ["plane-strain", "plane-stress"])
def test_planar_derivatives_match_central_differences(section):
    law, parameters = Both(), np.array([1.0, 0.7, 0.4])
    a, J, h = np.array([2.3, 2.6, 3.1]), np.array([0.9, 1.05, 1.2]), 1e-4

    def at(da, dj):
        return law.planar(parameters, a + da * h, J + dj * h, section)

    here = at(0, 0)
    for derivative, up, down in (
        (here.a, at(1, 0)[0], at(-1, 0)[0]),
        (here.J, at(0, 1)[0], at(0, -1)[0]),
        (here.aa, at(1, 0).a, at(-1, 0).a),
        (here.aJ, at(0, 1).a, at(0, -1).a),
        (here.aJ, at(1, 0).J, at(-1, 0).J),
        (here.JJ, at(0, 1).J, at(0, -1).J),
    ):
        assert derivative == pytest.approx((up - down) / (2 * h), rel=1e-6, abs=1e-8)
