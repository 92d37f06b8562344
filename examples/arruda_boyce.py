"""Add a hyperelastic law that the package does not contain: the eight-chain law of Arruda and Boyce, fitted to rubber.

    python -m examples.arruda_boyce

A law is one class. It contains the energy, the coordinates in a search, and the constants of the law in other programs.
The base class `InvariantLaw` tests the stability of the law and fits tensile curves. The script also fits the laws of
the package, for comparison.

Source of the energy: E. M. Arruda and M. C. Boyce 1993, J. Mech. Phys. Solids 41:389. The inverse Langevin function is
replaced by the first five terms of its series, as in Abaqus, ANSYS and CalculiX. Source of the curve: L. R. G. Treloar
1944, Trans. Faraday Soc. 40:59, simple tension up to a stretch of 5.36, nominal stress in kgf/cm².
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.laws import (
    LAWS,
    CardConstants,
    Coordinate,
    InvariantLaw,
    Material,
    NotInSolver,
    fit_tensile,
    material_card,
)
from eimi_fitting.laws.cards import plain_number
from eimi_fitting.laws.law import SHEAR_MODULUS_PA

Array = NDArray[np.float64]

_C = np.array([1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750])  # factor of I1^i for i from 1 to 5


@dataclass(frozen=True)
class ArrudaBoyce(InvariantLaw):
    """Arruda-Boyce law with the energy W = mu sum over i = 1..5 of C_i / lambda_m^(2 i - 2) (I1^i - 3^i).

    mu (Pa) and lambda_m are the parameters, I1 is the first invariant, and C_1 to C_5 are 1/2, 1/20, 11/1050, 19/7000
    and 519/673750. lambda_m is the stretch at which the molecular chains are fully extended.
    """

    name: str = "arruda-boyce"
    formula: str = "W = mu sum of C_i/lambda_m^(2i-2) (I1^i - 3^i), C = 1/2, 1/20, 11/1050, 19/7000, 519/673750"
    parameter_names: tuple[str, ...] = ("mu", "lambda_m")
    units: tuple[str, ...] = ("Pa", "1")
    coordinates: tuple[Coordinate, ...] = (
        Coordinate("initial shear modulus", *SHEAR_MODULUS_PA),
        Coordinate("1/lambda_m^2", 0.01, 0.7),  # the stress is almost linear in this coordinate
    )

    def from_coordinates(self, x: Array) -> Array:
        """Return the parameters mu (Pa) and lambda_m at K points of a search, shape (K, 2).

        The search does not vary the parameters themselves. Its coordinates `x`, shape (K, 2), are the initial shear
        modulus (Pa) and 1/lambda_m^2. mu is smaller than the initial shear modulus, see `initial_shear_modulus`.
        """
        locking = x[:, 1] ** -0.5
        return np.column_stack([x[:, 0] / _stiffening(locking), locking])

    def initial_shear_modulus(self, parameters: Array) -> Array:
        """Return the initial shear modulus, mu (1 + 3/(5 lambda_m^2) + 99/(175 lambda_m^4) + ...), Pa."""
        return parameters[..., 0] * _stiffening(parameters[..., 1])

    def coefficients(self, parameters: Array, x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
        """Return the energy W, dW/dI1, dW/dI2 and d²W/dI1² at I1 = x + 3 and I2 = y + 3, Pa each."""
        mu, over = parameters[..., 0], parameters[..., 1] ** -2
        first = x + 3
        series = [c * over**i for i, c in enumerate(_C)]
        energy = sum(c * _difference(x, i) for i, c in enumerate(series, 1))
        slope = sum(i * c * first ** (i - 1) for i, c in enumerate(series, 1))
        curvature = sum(i * (i - 1) * c * first ** (i - 2) for i, c in enumerate(series, 1) if i > 1)
        return mu * energy, mu * slope, np.zeros_like(x), mu * curvature

    def card(self, solver: str, p: Mapping[str, float], bulk: float) -> CardConstants:
        """Return the constants of the law in the program `solver`.

        Raises
        ------
        NotInSolver
            The program has no Arruda-Boyce law, or does not let the user choose `lambda_m` (SOFA).
        """
        mu, locking = p["mu"], p["lambda_m"]
        match solver:
            case "abaqus" | "calculix":
                constants = {"mu": mu, "lambda_m": locking, "D": 2 / bulk}
                volume = "((J^2 - 1)/2 - ln J)/D, D = 2/K"
                return CardConstants("ARRUDA-BOYCE", constants, volume=volume, notes=["card: mu, lambda_m, D"])
            case "ansys":
                constants = {"mu": mu, "lambda_L": locking, "d": 2 / bulk}
                return CardConstants("TB,HYPER,1,1,3,BOYCE", constants, volume="((J^2 - 1)/2 - ln J)/d, d = 2/K")
            case "comsol":
                return CardConstants(
                    "",
                    {"mu0": mu, "Nseg": locking**2},
                    dimensionless=["Nseg"],
                    meaning={"mu0": "macroscopic shear modulus", "Nseg": "number of segments, lambda_m^2"},
                )
            case "febio":
                # FEBio 4 has an Arruda-Boyce material, but its stress contains the factor i of each term twice
                # (FEArrudaBoyce.cpp). The card therefore states the energy as an expression.
                terms = ((plain_number(mu * c / locking ** (2 * i - 2)), i) for i, c in enumerate(_C, 1))
                return CardConstants(
                    "uncoupled hyperelastic",
                    {"W": " + ".join(f"({c})*(I1^{i}-{3**i})" for c, i in terms)},
                    notes=[
                        "written as an energy expression, because FEBio's own Arruda-Boyce material has another stress"
                    ],
                )
            case "sofa":
                raise NotInSolver("the arruda-boyce law cannot be exported to sofa: SOFA's law has a fixed lambda_m")
            case _:
                raise NotInSolver(f"the arruda-boyce law cannot be exported to {solver}")


def _stiffening(locking: Array) -> Array:
    """Return the initial shear modulus divided by mu, (2 / mu) dW/dI1 at I1 = 3, for each value of lambda_m.

    `locking` contains the values of lambda_m.
    """
    return np.asarray(sum(2 * i * c * 3.0 ** (i - 1) * locking ** (2 - 2 * i) for i, c in enumerate(_C, 1)))


def _difference(x: Array, i: int) -> Array:
    """Return (x + 3)^i - 3^i as a polynomial in x, which is accurate also for small x."""
    return np.asarray(x * sum((x + 3) ** k * 3.0 ** (i - 1 - k) for k in range(i)))


STRETCH = np.array([1.02, 1.125, 1.24, 1.39, 1.585, 1.9, 2.18, 2.42, 3.02, 3.57, 4.03, 4.76, 5.36])
STRESS_PA = 9.80665e4 * np.array([0.26, 1.37, 2.3, 3.23, 4.16, 5.1, 6.0, 6.9, 8.8, 10.7, 12.5, 16.2, 19.9])


def main() -> None:
    """Fit every law to Treloar's curve, and print a material card of the new law."""
    law = ArrudaBoyce()
    LAWS[law.name] = law  # from here on eimi_fitting and eimi_lab use the new law like the other laws
    for each in LAWS.values():
        fit = fit_tensile(each, STRETCH - 1, STRESS_PA)
        modulus, rmse = 1e-3 * fit.initial_shear_modulus_Pa, 1e-3 * fit.rmse_Pa
        limit = (
            "no limit of stability found" if fit.stable_to is None else f"stable up to a stretch of {fit.stable_to:.2f}"
        )
        print(f"{each.name:14} {modulus:6.1f} kPa, root mean square error {rmse:5.1f} kPa, {limit}")
    fit = fit_tensile(law, STRETCH - 1, STRESS_PA)
    bulk = 2000 * fit.initial_shear_modulus_Pa
    print(material_card("calculix", Material(law, fit.parameters, bulk, "RUBBER", ("Treloar 1944, simple tension",))))


if __name__ == "__main__":
    main()
