"""The Neo-Hookean law: the strain energy of a network of Gaussian chains, with one modulus.

Source: Holzapfel, Nonlinear Solid Mechanics, 2000, section 6.5.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.laws.invariants import InvariantLaw
from eimi_fitting.laws.law import SHEAR_MODULUS_PA, CardConstants, Coordinate, NotInSolver, StressFit
from eimi_fitting.laws.tensile import linear_least_squares

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NeoHookean(InvariantLaw):
    """The Neo-Hookean law, W = mu/2 (I1 - 3). Its initial shear modulus is mu."""

    name: str = "neo-hookean"
    formula: str = "W = mu/2 (I1 - 3)"
    parameter_names: tuple[str, ...] = ("mu",)
    units: tuple[str, ...] = ("Pa",)
    coordinates: tuple[Coordinate, ...] = (Coordinate("mu", *SHEAR_MODULUS_PA),)

    def from_coordinates(self, x: Array) -> Array:
        """Return the parameter mu, (P, 1), from the only coordinate of the search, which is mu itself."""
        return x[:, :1]

    def initial_shear_modulus(self, parameters: Array) -> Array:
        """Return the initial shear modulus of the Neo-Hookean law, mu."""
        return parameters[..., 0]

    def coefficients(self, parameters: Array, x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
        """Return W = mu/2 x, with x = I1 - 3, and its derivatives dW/dx, dW/dy and d²W/dx².

        y = I2 - 3 has no influence.
        """
        half = 0.5 * parameters[..., 0]
        zero = np.zeros_like(x)
        return half * x, half + zero, zero, zero

    def drucker_limit(self, parameters: Array, largest_stretch: Array) -> Array:
        """Return the largest stable stretch for P values of mu, (P,): infinity if mu is positive, else 0."""
        return np.where(parameters[:, 0] > 0, np.inf, 0.0)

    def fit_stress(self, strain: Array, stress: Array, weight: Array) -> StressFit:
        """Fit the Neo-Hookean law to a tensile curve by linear least squares."""
        return linear_least_squares(self, strain, stress, weight)

    def card(self, solver: str, p: Mapping[str, float], bulk: float) -> CardConstants:
        """Return the constants of the Neo-Hookean law for a finite-element program."""
        mu = p["mu"]
        match solver:
            case "abaqus" | "calculix":
                constants = {"C10": mu / 2, "D1": 2 / bulk}
                return CardConstants("NEO HOOKE", constants, notes=["card: C10 = mu/2, D1"])
            case "ansys":
                return CardConstants("TB,HYPER,1,1,2,NEO", {"mu": mu, "d": 2 / bulk})
            case "comsol":
                return CardConstants("", {"mu": mu})
            case "febio":
                return CardConstants("incomp neo-Hookean", {"G": mu})
            case "sofa":
                young, poisson = 9 * bulk * mu / (3 * bulk + mu), (3 * bulk - 2 * mu) / (6 * bulk + 2 * mu)
                return CardConstants(
                    "NeoHookean",
                    {"mu": mu, "lambda": bulk - 2 * mu / 3},
                    volume="-mu ln(J) + lambda/2 ln(J)^2, lambda = K - 2 mu/3",
                    notes=[
                        "SOFA uses the full invariant I1 here, not the isochoric one; both are equal at J = 1",
                        "the component beside HyperelasticityFEMForceField is NeoHookeanMaterial with "
                        f"youngModulus = {young:.10g}, poissonRatio = {poisson:.10g}",
                    ],
                )
            case _:
                raise NotInSolver(f"the neo-hookean law cannot be exported to {solver}; choose another program")
