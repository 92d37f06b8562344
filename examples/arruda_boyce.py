"""Add a law from outside the package: fit the eight-chain law of Arruda and Boyce to rubber, beside the four laws.

    python -m examples.arruda_boyce

A law is one class with its energy, its coordinates in a search, and its constants in other programs. The base class
`InvariantLaw` scans for stability and fits tensile curves.

Energy: E. M. Arruda and M. C. Boyce 1993, J. Mech. Phys. Solids 41:389. The inverse Langevin function is represented by
the first five terms of its series, as in Abaqus, ANSYS and CalculiX. Curve: L. R. G. Treloar 1944, Trans. Faraday Soc.
40:59, simple tension up to a stretch of 5.36, nominal stress in kgf/cm².
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
    """Arruda-Boyce law: psi = mu sum over i = 1..5 of C_i / lambda_m^(2 i - 2) (I1^i - 3^i).

    The chains lock at the stretch lambda_m.
    """

    name: str = "arruda-boyce"
    formula: str = "W = mu sum of C_i/lambda_m^(2i-2) (I1^i - 3^i), C = 1/2, 1/20, 11/1050, 19/7000, 519/673750"
    parameter_names: tuple[str, ...] = ("mu", "lambda_m")
    units: tuple[str, ...] = ("Pa", "1")
    coordinates: tuple[Coordinate, ...] = (
        Coordinate("initial shear modulus", *SHEAR_MODULUS_PA),
        Coordinate("1/lambda_m^2", 0.01, 0.7),  # the stress is almost linear in it, which suits the intervals
    )

    def from_coordinates(self, x: Array) -> Array:
        """Return mu and lambda_m. Short chains stiffen rubber at rest, so that mu is less than the shear modulus."""
        locking = x[:, 1] ** -0.5
        return np.column_stack([x[:, 0] / _stiffening(locking), locking])

    def initial_shear_modulus(self, parameters: Array) -> Array:
        """Return mu (1 + 3/(5 lambda_m^2) + 99/(175 lambda_m^4) + ...) in Pa."""
        return parameters[..., 0] * _stiffening(parameters[..., 1])

    def coefficients(self, parameters: Array, x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
        """Return the energy, its derivatives in I1 and I2, and its second derivative in I1, at I1 = x + 3."""
        mu, over = parameters[..., 0], parameters[..., 1] ** -2
        first = x + 3
        series = [c * over**i for i, c in enumerate(_C)]
        energy = sum(c * _difference(x, i) for i, c in enumerate(series, 1))
        slope = sum(i * c * first ** (i - 1) for i, c in enumerate(series, 1))
        curvature = sum(i * (i - 1) * c * first ** (i - 2) for i, c in enumerate(series, 1) if i > 1)
        return mu * energy, mu * slope, np.zeros_like(x), mu * curvature

    def card(self, solver: str, p: Mapping[str, float], bulk: float) -> CardConstants:
        """Return the constants of a program; SOFA has no such law, because its chains have a fixed length."""
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
                raise NotInSolver("sofa's arruda-boyce law has one fixed length of chains: lambda_m has no place in it")
            case _:
                raise NotInSolver(f"the arruda-boyce law cannot be exported to {solver}")


def _stiffening(locking: Array) -> Array:
    """Return the initial shear modulus divided by mu; the quotient is 2 W' / mu at I1 = 3."""
    return np.asarray(sum(2 * i * c * 3.0 ** (i - 1) * locking ** (2 - 2 * i) for i, c in enumerate(_C, 1)))


def _difference(x: Array, i: int) -> Array:
    """Return (x + 3)^i - 3^i without cancellation for small x."""
    return np.asarray(x * sum((x + 3) ** k * 3.0 ** (i - 1 - k) for k in range(i)))


STRETCH = np.array([1.02, 1.125, 1.24, 1.39, 1.585, 1.9, 2.18, 2.42, 3.02, 3.57, 4.03, 4.76, 5.36])
STRESS_PA = 9.80665e4 * np.array([0.26, 1.37, 2.3, 3.23, 4.16, 5.1, 6.0, 6.9, 8.8, 10.7, 12.5, 16.2, 19.9])


def main() -> None:
    """Fit every law to the curve, and print a card of the new law."""
    law = ArrudaBoyce()
    LAWS[law.name] = law  # from here on it is a law like the others, in eimi_lab too
    for each in LAWS.values():
        fit = fit_tensile(each, STRETCH - 1, STRESS_PA)
        modulus, rmse = 1e-3 * fit.initial_shear_modulus_Pa, 1e-3 * fit.rmse_Pa
        limit = "no limit met" if fit.stable_to is None else f"stable up to {fit.stable_to:.2f}"
        print(f"{each.name:14} {modulus:6.1f} kPa, RMSE {rmse:5.1f} kPa, {limit}")
    fit = fit_tensile(law, STRETCH - 1, STRESS_PA)
    bulk = 2000 * fit.initial_shear_modulus_Pa
    print(material_card("calculix", Material(law, fit.parameters, bulk, "RUBBER", ("Treloar 1944, simple tension",))))


if __name__ == "__main__":
    main()
