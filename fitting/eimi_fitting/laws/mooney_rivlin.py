"""The Mooney-Rivlin law: a strain energy that is linear in both invariants I1 and I2.

Source: Holzapfel, Nonlinear Solid Mechanics, 2000, section 6.5.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.laws.invariants import InvariantLaw
from eimi_fitting.laws.law import SHEAR_MODULUS_PA, CardConstants, Coordinate, NotInSolver, StressFit
from eimi_fitting.laws.stability import smallest_positive_root
from eimi_fitting.laws.tensile import linear_least_squares

Array = NDArray[np.float64]

# Coefficients in s = q - 1 of C10 (q^3 + 2) + C01 (2 q^4 + q), the slope of the stress in equibiaxial tension.
_STIFFNESS = np.array([[3.0, 3.0], [3.0, 9.0], [3.0, 12.0], [1.0, 8.0], [0.0, 2.0]])


@dataclass(frozen=True)
class MooneyRivlin(InvariantLaw):
    """The Mooney-Rivlin law, W = C10 (I1 - 3) + C01 (I2 - 3). Its initial shear modulus is 2 (C10 + C01)."""

    needs_second = True
    name: str = "mooney-rivlin"
    formula: str = "W = C10 (I1 - 3) + C01 (I2 - 3)"
    parameter_names: tuple[str, ...] = ("C10", "C01")
    units: tuple[str, ...] = ("Pa", "Pa")
    coordinates: tuple[Coordinate, ...] = (
        Coordinate("2(C10+C01)", *SHEAR_MODULUS_PA),
        Coordinate("C01/(C10+C01)", -0.5, 1.0),
    )

    def from_coordinates(self, x: Array) -> Array:
        """Return C10 and C01, (P, 2), from the coordinates of the search, (P, 2): 2 (C10 + C01), C01/(C10 + C01)."""
        mu0, share = x[:, 0], x[:, 1]
        return np.column_stack([0.5 * mu0 * (1 - share), 0.5 * mu0 * share])

    def initial_shear_modulus(self, parameters: Array) -> Array:
        """Return the initial shear modulus of the Mooney-Rivlin law, 2 (C10 + C01)."""
        return 2 * (parameters[..., 0] + parameters[..., 1])

    def coefficients(self, parameters: Array, x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
        """Return W = C10 x + C01 y, with x = I1 - 3 and y = I2 - 3, and its derivatives dW/dx, dW/dy and d²W/dx²."""
        c10, c01 = parameters[..., 0], parameters[..., 1]
        zero = np.zeros_like(x)
        return c10 * x + c01 * y, c10 + zero, c01 + zero, zero

    def drucker_limit(self, parameters: Array, largest_stretch: Array) -> Array:
        """Return the stretch in equibiaxial tension up to which the law is stable, for P sets of parameters, (P,).

        The result is infinity if the law is always stable, and 0 if it is unstable even without deformation.
        ``largest_stretch`` is not used.
        """
        # The law is stable where D = C10^2 I2 + C01^2 I1 + C10 C01 (I1 I2 - 3) > 0, the determinant of the restricted
        # Hessian up to a positive factor. Equibiaxial tension loses stability first: of all deformations with the same
        # I1 it has the largest I2, and D decreases with I2 where D = 0. If C01 < 0, the stress has its maximum at the
        # limit. If C10 < 0, a sheet stretches more in one of its two directions beyond the limit.
        c10, c01 = parameters.T
        limit = np.full(len(parameters), np.inf)
        bifurcating, softening = c10 < 0, c01 < 0
        limit[bifurcating] = np.abs(c01[bifurcating] / c10[bifurcating]) ** 0.25
        limit[softening] = np.sqrt(1 + smallest_positive_root(parameters[softening] @ _STIFFNESS.T))
        return np.where(c10 + c01 > 0, limit, 0.0)

    def fit_stress(self, strain: Array, stress: Array, weight: Array) -> StressFit:
        """Fit the Mooney-Rivlin law to a tensile curve by linear least squares."""
        return linear_least_squares(self, strain, stress, weight)

    def card(self, solver: str, p: Mapping[str, float], bulk: float) -> CardConstants:
        """Return the constants of the Mooney-Rivlin law for a finite-element program."""
        c10, c01 = p["C10"], p["C01"]
        match solver:
            case "abaqus" | "calculix":
                constants = {"C10": c10, "C01": c01, "D1": 2 / bulk}
                return CardConstants("MOONEY-RIVLIN", constants, notes=["card: C10, C01, D1"])
            case "ansys":
                return CardConstants("TB,HYPER,1,1,2,MOONEY", {"c10": c10, "c01": c01, "d": 2 / bulk})
            case "comsol":
                return CardConstants("", {"C10": c10, "C01": c01})
            case "febio":
                return CardConstants("Mooney-Rivlin", {"c1": c10, "c2": c01})
            case "sofa":
                note = (
                    "the component beside HyperelasticityFEMForceField is MooneyRivlinMaterial with mu10 = c1, "
                    "mu01 = c2, bulkModulus = k0"
                )
                return CardConstants("MooneyRivlin", {"c1": c10, "c2": c01, "k0": bulk}, notes=[note])
            case _:
                raise NotInSolver(f"the mooney-rivlin law cannot be exported to {solver}; choose another program")
