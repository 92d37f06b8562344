"""Fit a law that eimi_lab does not contain.

The law is a class that gives the energy, the initial shear modulus and the range of moduli to be searched.
"""

import eimi_lab as eimi
from eimi_fitting.laws import Coordinate, InvariantLaw


class Stiffening(InvariantLaw):
    name, formula = "stiffening", "W = mu/2 (x + x^2/10), x = I1 - 3"
    parameter_names, units, coordinates = ("mu",), ("Pa",), (Coordinate("initial shear modulus", 1e3, 1e6),)

    def from_coordinates(self, x):
        return x

    def initial_shear_modulus(self, parameters):
        return parameters[..., 0]

    def coefficients(self, parameters, x, y):
        half = parameters[..., 0] / 2
        return half * (x + x**2 / 10), half * (1 + x / 5), 0 * x, half / 5 + 0 * x


eimi.LAWS["stiffening"] = Stiffening()
result = eimi.fit("run.h5", "stiffening").initial_shear_modulus.value
