"""The materials of the specimens of the study: two laws that are not among the fitted laws.

Both laws soften at the small strains of a bending beam and stiffen at large strains, as published tensile curves of
such silicones do. Both laws depend on the second invariant. The moduli are of the order of published tensile tests. The
functions and their numbers are chosen by this project.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.laws import Coordinate, InvariantLaw, Law, engineering_stress
from eimi_fitting.laws.law import SHEAR_MODULUS_PA

Array = NDArray[np.float64]

_MODULUS = Coordinate("initial shear modulus", *SHEAR_MODULUS_PA)


class _OfOneShape(InvariantLaw):
    """A law whose strain energy is the initial shear modulus times a fixed function of the invariants."""

    needs_second = True
    parameter_names = ("mu",)
    units = ("Pa",)
    coordinates = (_MODULUS,)

    def from_coordinates(self, x: Array) -> Array:
        """Return the initial shear modulus of P candidates (sets of parameters) in Pa, shape (P, 1).

        The modulus is the only parameter of the law, and a search uses the modulus itself as its coordinate. `x` holds
        this coordinate of each candidate, shape (P, 1).
        """
        return x[:, :1]

    def initial_shear_modulus(self, parameters: Array) -> Array:
        """Return the initial shear modulus in Pa, the only parameter of the law."""
        return np.asarray(parameters[..., 0])


class PowersOfFirstInvariant(_OfOneShape):
    """A law with three powers of the first invariant I1 and a linear term in the second invariant I2.

    W = mu (sum of 3^(1-a)/(2a) m (I1^a - 3^a) + c (I2 - 3)). The sum over the three powers a, with the weights m, is
    the law of Lopez-Pamies (2010, C. R. Mécanique 338:3). The weights and c are chosen such that Σ m + 2 c = 1. The
    factor mu is then the initial shear modulus. The attributes are a (`powers`), m (`shares`) and c (`second`).
    """

    name = "powers of I1, and I2"
    formula = "W = mu (sum of 3^(1-a)/(2a) m (I1^a - 3^a) + c (I2 - 3))"
    shares = np.array([0.24, 0.64, 0.02])
    powers = np.array([-10.0, 1.0, 2.4])
    second = 0.05

    def coefficients(self, parameters: Array, x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
        """Return the strain energy W and the derivatives ∂W/∂x, ∂W/∂y and ∂²W/∂x².

        Here x = I1 - 3 and y = I2 - 3, where I1 and I2 are the first and the second invariant. The functions log1p and
        expm1 keep the results accurate at small strains.
        """
        mu, growth = parameters[..., 0], np.log1p(x / 3)
        terms = list(zip(self.shares, self.powers, strict=True))
        energy = sum(1.5 * m / a * np.expm1(a * growth) for m, a in terms) + self.second * y
        slope = sum(0.5 * m * np.exp((a - 1) * growth) for m, a in terms)
        curvature = sum(m * (a - 1) / 6 * np.exp((a - 2) * growth) for m, a in terms)
        return mu * energy, mu * slope, self.second * mu + np.zeros_like(x), mu * curvature


class FadingGent(_OfOneShape):
    """The sum of Gent's law (1996, Rubber Chem. Technol. 69:59), a softening term and a term in I2.

    W = mu (-g Jm/2 ln(1 - (I1 - 3)/Jm) + f/(2 b) (1 - exp(-b (I1 - 3))) + c (I2 - 3)), with the invariants I1 and I2.
    The stiffness of the second term decreases exponentially with I1. The attributes are the constants of this formula:
    g (`lasting`), Jm (`most`), f (`fading`), b (`rate`) and c (`second`).
    """

    name = "fading Gent"
    formula = "W = mu (-g Jm/2 ln(1 - (I1 - 3)/Jm) + f/(2 b) (1 - exp(-b (I1 - 3))) + c (I2 - 3))"
    lasting, most, fading, rate, second = 0.66, 60.0, 0.26, 6.0, 0.04

    def coefficients(self, parameters: Array, x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
        """Return the strain energy W and the derivatives ∂W/∂x, ∂W/∂y and ∂²W/∂x².

        Here x = I1 - 3 and y = I2 - 3, where I1 and I2 are the first and the second invariant. The result is valid for
        x below the limit Jm of Gent's law.
        """
        mu, jm, room = parameters[..., 0], self.most, np.maximum(self.most - x, 1e-9)
        fade = np.exp(-self.rate * x)
        energy = -0.5 * self.lasting * jm * np.log(room / jm) - 0.5 * self.fading / self.rate * np.expm1(-self.rate * x)
        slope = 0.5 * self.lasting * jm / room + 0.5 * self.fading * fade
        curvature = 0.5 * self.lasting * jm / room**2 - 0.5 * self.fading * self.rate * fade
        return mu * (energy + self.second * y), mu * slope, self.second * mu + np.zeros_like(x), mu * curvature


@dataclass(frozen=True)
class HiddenMaterial:
    """A silicone of the study, whose law the fits do not know.

    Attributes
    ----------
    name : str
        The trade name of the silicone.
    law : Law
        The hyperelastic law with which the measurements are simulated.
    modulus_Pa : float
        Initial shear modulus in Pa.
    protocol : str
        The shipped protocol whose currents are used.
    tested_to : float
        Engineering strain at which the tensile test ends.
    numbers : str
        The constants of the law apart from the modulus, in words.
    """

    name: str
    law: Law
    modulus_Pa: float
    protocol: str
    tested_to: float
    numbers: str = ""

    @property
    def parameters(self) -> Array:
        """Return the initial shear modulus of the material in Pa as an array of shape (1, 1).

        The axes are one candidate and one parameter of the law.
        """
        return np.array([[self.modulus_Pa]])

    def tensile_curve(self) -> tuple[Array, Array]:
        """Return engineering strain and engineering stress (Pa) of a tensile test without measurement errors.

        Both arrays have the shape (m,), for m points of the curve.
        """
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
