"""The Yeoh law: a strain energy W that is a cubic polynomial in the first invariant I1.

Source: Holzapfel, Nonlinear Solid Mechanics, 2000, section 6.5.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from eimi_fitting.laws.cards import plain_number
from eimi_fitting.laws.invariants import InvariantLaw
from eimi_fitting.laws.law import SHEAR_MODULUS_PA, CardConstants, Coordinate, NotInSolver, StressFit
from eimi_fitting.laws.stability import smallest_positive_root
from eimi_fitting.laws.tensile import linear_least_squares

Array = NDArray[np.float64]


def _stability_polynomial() -> Array:
    """Return the coefficients of the polynomial whose smallest positive root gives the stability limit, (10, 3).

    Row k belongs to (q - 1)^k, where q is the square of the stretch in equibiaxial tension. The columns belong to C10,
    C20 and C30.
    """
    # The law is stable where D = W' (W' I2 + W'' (I1 I2 - 9)) > 0, the determinant of the restricted Hessian up to a
    # positive factor; a prime is d/dI1. Equibiaxial tension loses stability first: of all deformations with the same I1
    # it has the largest I2, and D decreases with I2 where D = 0. The polynomial is q^5 (W' I2 + W'' (I1 I2 - 9)).
    # With X = x(q) below: I1 - 3 = X/q^2, I2 = (q^3 + 2)/q and I1 I2 - 9 = 2 (q^3 - 1)^2/q^3.
    q = Polynomial([1.0, 1.0])
    x = 2 * q**3 - 3 * q**2 + 1
    second, growth = q**3 + 2, 2 * (q**3 - 1) ** 2
    columns = (
        q**4 * second,
        2 * x * q**2 * second + 2 * q**2 * growth,
        3 * x**2 * second + 6 * x * growth,
    )
    return np.stack([np.pad(c.coef, (0, 10 - len(c.coef))) for c in columns], axis=1)


_STABILITY = _stability_polynomial()


@dataclass(frozen=True)
class Yeoh(InvariantLaw):
    """The Yeoh law, W = C10 (I1 - 3) + C20 (I1 - 3)^2 + C30 (I1 - 3)^3. Its initial shear modulus is 2 C10."""

    name: str = "yeoh"
    formula: str = "W = C10 (I1 - 3) + C20 (I1 - 3)^2 + C30 (I1 - 3)^3"
    parameter_names: tuple[str, ...] = ("C10", "C20", "C30")
    units: tuple[str, ...] = ("Pa", "Pa", "Pa")
    coordinates: tuple[Coordinate, ...] = (
        Coordinate("2 C10", *SHEAR_MODULUS_PA),
        Coordinate("C20/C10", -1.0, 2.0),
        Coordinate("C30/C10", -2.0, 2.0),
    )

    def from_coordinates(self, x: Array) -> Array:
        """Return C10, C20 and C30, (P, 3), from the coordinates of the search, (P, 3): 2 C10, C20/C10, C30/C10."""
        return 0.5 * x[:, :1] * np.column_stack([np.ones(len(x)), x[:, 1], x[:, 2]])

    def initial_shear_modulus(self, parameters: Array) -> Array:
        """Return the initial shear modulus of the Yeoh law, 2 C10."""
        return 2 * parameters[..., 0]

    def coefficients(self, parameters: Array, x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
        """Return W = C10 x + C20 x^2 + C30 x^3, with x = I1 - 3, and its derivatives dW/dx, dW/dy and d²W/dx².

        y = I2 - 3 has no influence.
        """
        c10, c20, c30 = parameters[..., 0], parameters[..., 1], parameters[..., 2]
        return (
            x * (c10 + x * (c20 + x * c30)),
            c10 + x * (2 * c20 + 3 * x * c30),
            np.zeros_like(x),
            2 * c20 + 6 * x * c30,
        )

    def drucker_limit(self, parameters: Array, largest_stretch: Array) -> Array:
        """Return the stretch in equibiaxial tension up to which the law is stable, for P sets of parameters, (P,).

        The result is infinity if the law is always stable, and 0 if the law is unstable at rest.
        """
        limit = np.full(len(parameters), np.inf)
        doubtful = (parameters[:, 1:] < 0).any(axis=1)
        limit[doubtful] = np.sqrt(1 + smallest_positive_root(parameters[doubtful] @ _STABILITY.T))
        return np.where(parameters[:, 0] > 0, limit, 0.0)

    def fit_stress(self, strain: Array, stress: Array, weight: Array) -> StressFit:
        """Fit the Yeoh law to a tensile curve by linear least squares."""
        return linear_least_squares(self, strain, stress, weight)

    def card(self, solver: str, p: Mapping[str, float], bulk: float) -> CardConstants:
        """Return the constants of the Yeoh law for a finite-element program."""
        c10, c20, c30 = p["C10"], p["C20"], p["C30"]
        match solver:
            case "abaqus" | "calculix":
                constants = {"C10": c10, "C20": c20, "C30": c30, "D1": 2 / bulk, "D2": 0.0, "D3": 0.0}
                return CardConstants("YEOH", constants, notes=["card: C10, C20, C30, D1, D2, D3"])
            case "ansys":
                return CardConstants("TB,HYPER,1,1,3,YEOH", {"c10": c10, "c20": c20, "c30": c30, "d": 2 / bulk})
            case "comsol":
                return CardConstants(
                    "", {"c1": c10, "c2": c20, "c3": c30}, meaning={"c1": "C10", "c2": "C20", "c3": "C30"}
                )
            case "febio":
                # FEBio's own Yeoh material omits the factor i in the stress of c_i (I1 - 3)^i.
                powers = (f"({plain_number(c)})*(I1-3)^{i}" for i, c in enumerate((c10, c20, c30), 1))
                note = "the stress of FEBio's own Yeoh material is not the derivative of its energy"
                return CardConstants(
                    "uncoupled hyperelastic",
                    {"W": " + ".join(powers)},
                    notes=[f"written as an energy expression, because {note}"],
                )
            case "sofa":
                raise NotInSolver(
                    "sofa has no yeoh law; the laws of sofa are neo-hookean, mooney-rivlin and one-term ogden"
                )
            case _:
                raise NotInSolver(f"the yeoh law cannot be exported to {solver}; choose another program")
