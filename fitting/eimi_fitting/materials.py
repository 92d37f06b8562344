"""Hyperelastic laws in their canonical form and the derivatives that a planar finite element needs.

A planar deformation enters an isotropic energy through two numbers only: a = F:F and J = det F of the in-plane
deformation gradient. Everything below is therefore psi(a, J) with its five derivatives, for two sections:

plane strain   third stretch 1; isochoric invariants I1 = J^(-2/3) (a + 1), I2 = J^(-4/3) (a + J^2);
               the volume term is the element's (a pressure unknown).
plane stress   incompressible, third stretch 1/J: I1 = a + J^-2, I2 = J^2 + a J^-2; no pressure is left.

Canonical energies: Holzapfel, Nonlinear Solid Mechanics (2000), section 6.5; Ogden's with the initial shear modulus
half the sum of mu_p alpha_p (his Eq. 6.120).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.specimen import Section

Array = NDArray[np.float64]


class PlanarEnergy(NamedTuple):
    """psi(a, J) and its derivatives, each an array of the shape of a."""

    value: Array
    a: Array
    J: Array
    aa: Array
    aJ: Array
    JJ: Array


class Law(Protocol):
    """A hyperelastic law. Parameters come as (..., n) arrays whose leading axes broadcast against a and J."""

    @property
    def name(self) -> str:
        """As the command line has it."""

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """In the order of the parameter arrays."""

    @property
    def units(self) -> tuple[str, ...]:
        """Pa or 1, one a parameter."""

    def initial_shear_modulus(self, parameters: Array) -> Array:
        """(..., n) -> (...): shear modulus at zero strain, in the unit of the moduli."""

    def planar(self, parameters: Array, a: Array, J: Array, section: Section) -> PlanarEnergy:
        """Energy density and derivatives of a planar state."""

    def principal(self, parameters: Array, stretches: Array) -> tuple[Array, Array, Array]:
        """Energy, gradient (..., 3) and Hessian (..., 3, 3) in the logarithms of the isochoric principal stretches."""


class _Invariant(NamedTuple):
    """An invariant of a planar state and its derivatives in (a, J)."""

    value: Array
    a: Array
    J: Array
    aJ: Array
    JJ: Array


def _first_invariant(a: Array, J: Array, section: Section) -> _Invariant:
    """First isochoric invariant of a planar state."""
    if section == "plane-stress":
        s = J**-2
        return _Invariant(a + s, np.ones_like(a), -2 * s / J, np.zeros_like(a), 6 * s**2)
    c = J ** (-2 / 3)
    value, over = c * (a + 1), 1 / J
    return _Invariant(value, c, -2 / 3 * value * over, -2 / 3 * c * over, 10 / 9 * value * over * over)


def _second_invariant(a: Array, J: Array, section: Section) -> _Invariant:
    """Second isochoric invariant of a planar state."""
    if section == "plane-stress":
        s = J**-2
        return _Invariant(J**2 + a * s, s, 2 * J - 2 * a * s / J, -2 * s / J, 2 + 6 * a * s**2)
    c = J ** (-4 / 3)
    return _Invariant(
        c * (a + J**2),
        c,
        c * (2 / 3 * J - 4 / 3 * a / J),
        -4 / 3 * c / J,
        c * (28 / 9 * a / J**2 - 2 / 9),
    )


class _InvariantLaw(ABC):
    """A law that is a function of I1 - 3 and I2 - 3: subclasses give W and its derivatives."""

    needs_second = False  # whether I2 enters at all

    @abstractmethod
    def coefficients(self, parameters: Array, x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
        """W, W_x, W_y, W_xx at x = I1 - 3, y = I2 - 3 (none of the laws here has another second derivative)."""

    def planar(self, parameters: Array, a: Array, J: Array, section: Section) -> PlanarEnergy:
        """Energy density and derivatives of a planar state."""
        i1 = _first_invariant(a, J, section)
        if not self.needs_second:
            w, w1, _, w11 = self.coefficients(parameters, i1.value - 3, np.zeros(()))
            slope = w11 * i1.a
            return PlanarEnergy(
                w, w1 * i1.a, w1 * i1.J, slope * i1.a, w1 * i1.aJ + slope * i1.J, w1 * i1.JJ + w11 * i1.J**2
            )
        i2 = _second_invariant(a, J, section)
        w, w1, w2, w11 = self.coefficients(parameters, i1.value - 3, i2.value - 3)
        return PlanarEnergy(
            w,
            w1 * i1.a + w2 * i2.a,
            w1 * i1.J + w2 * i2.J,
            w11 * i1.a**2,
            w1 * i1.aJ + w2 * i2.aJ + w11 * i1.a * i1.J,
            w1 * i1.JJ + w2 * i2.JJ + w11 * i1.J**2,
        )

    def principal(self, parameters: Array, stretches: Array) -> tuple[Array, Array, Array]:
        """Energy, gradient (..., 3) and Hessian (..., 3, 3) in the logarithms of the isochoric principal stretches."""
        q, r = stretches**2, stretches**-2
        w, w1, w2, w11 = self.coefficients(parameters, q.sum(-1) - 3, r.sum(-1) - 3)
        gradient = 2 * w1[..., None] * q - 2 * w2[..., None] * r
        diagonal = 4 * w1[..., None] * q + 4 * w2[..., None] * r
        hessian = diagonal[..., None] * np.eye(3) + 4 * w11[..., None, None] * q[..., :, None] * q[..., None, :]
        return w, gradient, hessian


@dataclass(frozen=True)
class NeoHookean(_InvariantLaw):
    """psi = mu/2 (I1 - 3); the initial shear modulus is mu."""

    name: str = "neo-hookean"
    parameter_names: tuple[str, ...] = ("mu",)
    units: tuple[str, ...] = ("Pa",)

    def initial_shear_modulus(self, parameters: Array) -> Array:
        """mu."""
        return parameters[..., 0]

    def coefficients(self, parameters: Array, x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
        """psi = mu/2 x."""
        half = 0.5 * parameters[..., 0]
        zero = np.zeros_like(x)
        return half * x, half + zero, zero, zero


@dataclass(frozen=True)
class MooneyRivlin(_InvariantLaw):
    """psi = C10 (I1 - 3) + C01 (I2 - 3); the initial shear modulus is 2 (C10 + C01)."""

    needs_second = True
    name: str = "mooney-rivlin"
    parameter_names: tuple[str, ...] = ("C10", "C01")
    units: tuple[str, ...] = ("Pa", "Pa")

    def initial_shear_modulus(self, parameters: Array) -> Array:
        """2 (C10 + C01)."""
        return 2 * (parameters[..., 0] + parameters[..., 1])

    def coefficients(self, parameters: Array, x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
        """psi = C10 x + C01 y."""
        c10, c01 = parameters[..., 0], parameters[..., 1]
        zero = np.zeros_like(x)
        return c10 * x + c01 * y, c10 + zero, c01 + zero, zero


@dataclass(frozen=True)
class Yeoh(_InvariantLaw):
    """psi = C10 (I1 - 3) + C20 (I1 - 3)^2 + C30 (I1 - 3)^3; the initial shear modulus is 2 C10."""

    name: str = "yeoh"
    parameter_names: tuple[str, ...] = ("C10", "C20", "C30")
    units: tuple[str, ...] = ("Pa", "Pa", "Pa")

    def initial_shear_modulus(self, parameters: Array) -> Array:
        """2 C10."""
        return 2 * parameters[..., 0]

    def coefficients(self, parameters: Array, x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
        """psi = C10 x + C20 x^2 + C30 x^3."""
        c10, c20, c30 = parameters[..., 0], parameters[..., 1], parameters[..., 2]
        return (
            x * (c10 + x * (c20 + x * c30)),
            c10 + x * (2 * c20 + 3 * x * c30),
            np.zeros_like(x),
            2 * c20 + 6 * x * c30,
        )


_SERIES_TO = 0.1  # c - 1, and
_SERIES_PRODUCT = 2.0  # nu^2 (c - 1), up to which ten terms are enough


def _terms(nu2: float, z: float) -> int:
    """How many terms of the series reach rounding for the second derivative, at most ten."""
    z = min(z, _SERIES_TO, _SERIES_PRODUCT / nu2)
    term = 1.0
    for k in range(10):
        term *= (nu2 + k * k) * z / ((2 * k + 1) * (k + 1))
        if k >= 2 and term * (k + 1) * k < 1e-16 * z * z:
            return k + 1
    return 10


def _cosh_of_scaled_angle(nu: Array, c: Array) -> tuple[Array, Array, Array]:
    """g(c) = cosh(nu arccosh c) for c >= 1 with its first two derivatives in c.

    (lambda1^alpha + lambda2^alpha) = 2 J^(alpha/2) g with nu = alpha/2 and c = a / (2 J) = cosh of the logarithm of
    lambda1/lambda2. Near c = 1 (equal stretches) the closed forms are 0/0; g is the Chebyshev function T_nu there,
    whose series in c - 1 has the coefficient ratio (nu^2 - k^2) / ((2k + 1)(k + 1)) (Abramowitz and Stegun 15.4.3).
    """
    z = np.maximum(c - 1.0, 0.0)
    nu2 = nu * nu
    n_terms = _terms(float(np.abs(nu2).max(initial=1.0)), float(z.max(initial=0.0)))
    coefficients = [np.ones_like(nu2)]
    for k in range(n_terms):
        coefficients.append(coefficients[-1] * (nu2 - k * k) / ((2 * k + 1) * (k + 1)))
    g = np.zeros_like(z + nu2)
    g1, g2 = g.copy(), g.copy()
    for k in range(n_terms, -1, -1):  # Horner for the value and both derivatives at once
        g2 = g2 * z + 2 * g1
        g1 = g1 * z + g
        g = g * z + coefficients[k]
    far = (z > _SERIES_TO) | (nu2 * z > _SERIES_PRODUCT)
    if np.any(far):
        z_far = np.where(far, z, 1.0)
        angle = np.arccosh(1.0 + z_far)
        sinh = np.sqrt(z_far * (z_far + 2.0))
        with np.errstate(over="ignore", invalid="ignore"):
            value = np.cosh(nu * angle)
            first = nu * np.sinh(nu * angle) / sinh
            second = (nu2 * value - (1.0 + z_far) * first) / sinh**2
        g, g1, g2 = np.where(far, value, g), np.where(far, first, g1), np.where(far, second, g2)
    return g, g1, g2


@dataclass(frozen=True)
class Ogden:
    """psi = sum over p = 1..3 of mu_p/alpha_p (l1^alpha_p + l2^alpha_p + l3^alpha_p - 3).

    The initial shear modulus is half the sum of mu_p alpha_p. A term with alpha_p = 0 is refused by its bounds.
    """

    name: str = "ogden"
    parameter_names: tuple[str, ...] = ("mu1", "alpha1", "mu2", "alpha2", "mu3", "alpha3")
    units: tuple[str, ...] = ("Pa", "1", "Pa", "1", "Pa", "1")

    def initial_shear_modulus(self, parameters: Array) -> Array:
        """Half the sum of mu_p alpha_p."""
        return 0.5 * np.sum(parameters[..., 0::2] * parameters[..., 1::2], axis=-1)

    def planar(self, parameters: Array, a: Array, J: Array, section: Section) -> PlanarEnergy:
        """Energy density and derivatives of a planar state; equal stretches are no special case."""
        c = a / (2 * J)
        log_J = np.log(J)
        total = [np.zeros_like(c) for _ in range(6)]
        for p in range(3):
            mu, alpha = parameters[..., 2 * p], parameters[..., 2 * p + 1]
            # In-plane terms are 2 J^beta g(c), the third stretch gives J^-gamma.
            beta, gamma = (alpha / 2, alpha) if section == "plane-stress" else (alpha / 6, alpha / 3)
            g, g1, g2 = _cosh_of_scaled_angle(alpha / 2, c)
            scale = mu / alpha
            in_plane = scale * np.exp(beta * log_J)
            third = scale * np.exp(-gamma * log_J)
            over_J2 = in_plane / J**2
            mixed = (beta - 1) * g1 - c * g2
            total[0] += 2 * in_plane * g + third - 3 * scale
            total[1] += in_plane / J * g1
            total[2] += 2 * in_plane / J * (beta * g - c * g1) - gamma * third / J
            total[3] += 0.5 * over_J2 * g2
            total[4] += over_J2 * mixed
            total[5] += (
                2 * over_J2 * ((beta - 1) * (beta * g - c * g1) - c * mixed) + gamma * (gamma + 1) * third / J**2
            )
        return PlanarEnergy(*total)

    def principal(self, parameters: Array, stretches: Array) -> tuple[Array, Array, Array]:
        """Energy, gradient (..., 3) and Hessian (..., 3, 3) in the logarithms of the isochoric principal stretches."""
        mu, alpha = parameters[..., None, 0::2], parameters[..., None, 1::2]
        powers = stretches[..., :, None] ** alpha
        energy = np.sum(mu / alpha * (powers - 1), axis=(-1, -2))
        gradient = np.sum(mu * powers, axis=-1)
        diagonal = np.sum(mu * alpha * powers, axis=-1)
        return energy, gradient, diagonal[..., None] * np.eye(3)


LAWS: dict[str, Law] = {law.name: law for law in (NeoHookean(), MooneyRivlin(), Yeoh(), Ogden())}
