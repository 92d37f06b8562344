"""The true materials of the simulated specimens: two laws that are not among the fitted laws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.laws import Coordinate, InvariantLaw, Law, engineering_stress
from eimi_fitting.laws.law import SHEAR_MODULUS_PA

Array = NDArray[np.float64]

_MODULUS = Coordinate("initial shear modulus", *SHEAR_MODULUS_PA)


class _OfOneShape(InvariantLaw):
    """A law whose only parameter, the initial shear modulus, is a factor of the strain energy."""

    needs_second = True
    parameter_names = ("mu",)
    units = ("Pa",)
    coordinates = (_MODULUS,)

    def from_coordinates(self, x: Array) -> Array:
        """Return the first column of `x`: the initial shear modulus (Pa) of P candidates, shape (P, 1)."""
        return x[:, :1]

    def initial_shear_modulus(self, parameters: Array) -> Array:
        """Return the initial shear modulus in Pa, the only parameter of the law."""
        return np.asarray(parameters[..., 0])


class PowersOfFirstInvariant(_OfOneShape):
    """A law with three powers of the invariant I1 (Lopez-Pamies 2010, C. R. Mécanique 338:3) and a linear term in I2.

    W = mu (sum of 3^(1-a)/(2a) m (I1^a - 3^a) + c (I2 - 3)), with Σ m + 2 c = 1 and the initial shear modulus mu. The
    attributes are a (`powers`), m (`shares`) and c (`second`).
    """

    name = "powers of I1, and I2"
    formula = "W = mu (sum of 3^(1-a)/(2a) m (I1^a - 3^a) + c (I2 - 3))"
    shares = np.array([0.24, 0.64, 0.02])
    powers = np.array([-10.0, 1.0, 2.4])
    second = 0.05

    def coefficients(self, parameters: Array, x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
        """Return the strain energy W with ∂W/∂x, ∂W/∂y and ∂²W/∂x², where x = I1 - 3 and y = I2 - 3."""
        mu, growth = parameters[..., 0], np.log1p(x / 3)
        terms = list(zip(self.shares, self.powers, strict=True))
        energy = sum(1.5 * m / a * np.expm1(a * growth) for m, a in terms) + self.second * y
        slope = sum(0.5 * m * np.exp((a - 1) * growth) for m, a in terms)
        curvature = sum(m * (a - 1) / 6 * np.exp((a - 2) * growth) for m, a in terms)
        return mu * energy, mu * slope, self.second * mu + np.zeros_like(x), mu * curvature


class FadingGent(_OfOneShape):
    """The sum of Gent's law (1996, Rubber Chem. Technol. 69:59), a softening term and a term in I2.

    W = mu (-g Jm/2 ln(1 - (I1 - 3)/Jm) + f/(2 b) (1 - exp(-b (I1 - 3))) + c (I2 - 3)), with the invariants I1 and I2,
    and the initial shear modulus mu. The attributes are g (`lasting`), Jm (`most`), f (`fading`), b (`rate`) and c
    (`second`).
    """

    name = "fading Gent"
    formula = "W = mu (-g Jm/2 ln(1 - (I1 - 3)/Jm) + f/(2 b) (1 - exp(-b (I1 - 3))) + c (I2 - 3))"
    lasting, most, fading, rate, second = 0.66, 60.0, 0.26, 6.0, 0.04

    def coefficients(self, parameters: Array, x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
        """Return the strain energy W with ∂W/∂x, ∂W/∂y and ∂²W/∂x², where x = I1 - 3 and y = I2 - 3."""
        mu, jm, room = parameters[..., 0], self.most, np.maximum(self.most - x, 1e-9)
        fade = np.exp(-self.rate * x)
        energy = -0.5 * self.lasting * jm * np.log(room / jm) - 0.5 * self.fading / self.rate * np.expm1(-self.rate * x)
        slope = 0.5 * self.lasting * jm / room + 0.5 * self.fading * fade
        curvature = 0.5 * self.lasting * jm / room**2 - 0.5 * self.fading * self.rate * fade
        return mu * (energy + self.second * y), mu * slope, self.second * mu + np.zeros_like(x), mu * curvature


@dataclass(frozen=True)
class HiddenMaterial:
    """The material of simulated specimens, whose law the fits do not know.

    Attributes
    ----------
    name : str
        Trade name of the silicone.
    law : Law
        Hyperelastic law.
    modulus_Pa : float
        Initial shear modulus.
    protocol : str
        Protocol with the currents.
    tested_to : float
        Largest engineering strain of the tensile test.
    numbers : str
        Other constants of the law, in words.
    """

    name: str
    law: Law
    modulus_Pa: float
    protocol: str
    tested_to: float
    numbers: str = ""

    @property
    def parameters(self) -> Array:
        """Return the initial shear modulus in Pa as an array of shape (1, 1)."""
        return np.array([[self.modulus_Pa]])

    def tensile_curve(self) -> tuple[Array, Array]:
        """Return engineering strain and engineering stress (Pa) of a tensile test without measurement errors."""
        strain = np.linspace(0.01, self.tested_to, round(100 * self.tested_to))
        return strain, engineering_stress(self.law, self.parameters[0], strain)


MATERIALS = {
    "dragon_skin_10": HiddenMaterial(
        "like Dragon Skin 10",
        PowersOfFirstInvariant(),
        52e3,
        "dragon_skin_10",
        tested_to=6.0,
        numbers="a = -10, 1, 2.4 with m = 0.24, 0.64, 0.02; c = 0.05",
    ),
    "ecoflex_00_50": HiddenMaterial(
        "like Ecoflex 00-50",
        FadingGent(),
        22e3,
        "ecoflex_00_50",
        tested_to=6.0,
        numbers="g = 0.66, Jm = 60, f = 0.26, b = 6, c = 0.04",
    ),
}
