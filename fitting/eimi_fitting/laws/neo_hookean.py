"""Neo-Hookean: Gaussian chains, one modulus (Holzapfel, Nonlinear Solid Mechanics, 2000, section 6.5)."""

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
    """psi = mu/2 (I1 - 3); the initial shear modulus is mu."""

    name: str = "neo-hookean"
    formula: str = "W = mu/2 (I1 - 3)"
    parameter_names: tuple[str, ...] = ("mu",)
    units: tuple[str, ...] = ("Pa",)
    coordinates: tuple[Coordinate, ...] = (Coordinate("mu", *SHEAR_MODULUS_PA),)

    def from_coordinates(self, x: Array) -> Array:
        """The modulus itself."""
        return x[:, :1]

    def initial_shear_modulus(self, parameters: Array) -> Array:
        """mu."""
        return parameters[..., 0]

    def coefficients(self, parameters: Array, x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
        """psi = mu/2 x."""
        half = 0.5 * parameters[..., 0]
        zero = np.zeros_like(x)
        return half * x, half + zero, zero, zero

    def drucker_limit(self, parameters: Array, most: Array) -> Array:
        """Everywhere or nowhere."""
        return np.where(parameters[:, 0] > 0, np.inf, 0.0)

    def fit_stress(self, strain: Array, stress: Array, weight: Array) -> StressFit:
        """The stress is linear in mu."""
        return linear_least_squares(self, strain, stress, weight)

    def card(self, solver: str, p: Mapping[str, float], bulk: float) -> CardConstants:
        """In every program."""
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
                return CardConstants(
                    "NeoHookean",
                    {"mu": mu, "lambda": bulk - 2 * mu / 3},
                    volume="-mu ln(J) + lambda/2 ln(J)^2, lambda = K - 2 mu/3",
                    notes=["I1 is not isochoric in this law of SOFA: the same where J is 1"],
                )
            case _:
                raise NotInSolver(f"{solver} has no neo-hookean law here")
