"""The Ogden law: a strain energy with three powers of the principal stretches.

Source: Holzapfel, Nonlinear Solid Mechanics, 2000, section 6.5.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
import scipy
from numpy.typing import NDArray

from eimi_fitting.laws.law import (
    SHEAR_MODULUS_PA,
    CannotFit,
    CardConstants,
    Coordinate,
    Law,
    NotInSolver,
    PlanarEnergy,
    Section,
    StressFit,
)
from eimi_fitting.laws.stable_cells import proved_stable
from eimi_fitting.laws.tensile import correlation_of, covariance_of, engineering_stress

Array = NDArray[np.float64]

_STARTS_EACH = 2  # starting values of each exponent of a tensile fit

# The series with ten terms is used while c - 1 and nu^2 (c - 1) are below these limits.
_SERIES_TO = 0.1
_SERIES_PRODUCT = 2.0


def _number_of_terms(nu2: float, z: float) -> int:
    """Return how many terms of the Taylor series of cosh(nu arccosh c) at c = 1 give full precision, at most ten.

    nu2: largest value of nu^2. z: largest value of c - 1.
    """
    # So many terms are also enough for the second derivative.
    term = 1.0
    for k in range(10):
        term *= (nu2 + k * k) * z / ((2 * k + 1) * (k + 1))
        if k >= 2 and term * (k + 1) * k < 1e-16 * z * z:
            return k + 1
    return 10


def _cosh_of_scaled_angle(nu: Array, c: Array) -> tuple[Array, Array, Array]:
    """Return g(c) = cosh(nu arccosh c) for c >= 1, and its first two derivatives by c."""
    # At c = 1 the usual formulas of the derivatives are 0/0. Near c = 1, g is computed as the power series of the
    # Chebyshev function T_nu (Abramowitz and Stegun, 15.4.3): the sum of b_k (c - 1)^k with b_0 = 1 and
    # b_(k+1) / b_k = (nu^2 - k^2) / ((2k + 1)(k + 1)).
    z = np.maximum(c - 1.0, 0.0)
    nu2 = nu * nu
    n_terms = _number_of_terms(float(np.abs(nu2).max(initial=1.0)), float(z.max(initial=0.0)))
    coefficients = [np.ones_like(nu2)]
    for k in range(n_terms):
        coefficients.append(coefficients[-1] * (nu2 - k * k) / ((2 * k + 1) * (k + 1)))
    g = np.zeros_like(z + nu2)
    g1, g2 = g.copy(), g.copy()
    for k in range(n_terms, -1, -1):  # Horner's scheme in place for the value, the slope and half the second derivative
        g2 *= z
        g2 += g1
        g1 *= z
        g1 += g
        g *= z
        g += coefficients[k]
    g2 *= 2
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
    """The Ogden law, W = sum over p = 1..3 of mu_p/alpha_p (l1^alpha_p + l2^alpha_p + l3^alpha_p - 3).

    l1, l2 and l3 are the principal stretches. The initial shear modulus is half the sum of mu_p alpha_p (Holzapfel's
    Eq. 6.120). If mu_p alpha_p is positive in every term, the law is stable (Hill 1970, J. Mech. Phys. Solids 18:457).
    """

    name: str = "ogden"
    formula: str = "W = sum of mu_p/alpha_p (l1^alpha_p + l2^alpha_p + l3^alpha_p - 3), p = 1..3"
    parameter_names: tuple[str, ...] = ("mu1", "alpha1", "mu2", "alpha2", "mu3", "alpha3")
    units: tuple[str, ...] = ("Pa", "1", "Pa", "1", "Pa", "1")
    coordinates: tuple[Coordinate, ...] = (
        Coordinate("half sum mu alpha", *SHEAR_MODULUS_PA),
        Coordinate("share of term 1", 0.0, 1.0),
        Coordinate("share of term 2 in the rest", 0.0, 1.0),
        Coordinate("alpha1", 0.5, 4.0),
        Coordinate("alpha2", 4.0, 12.0),
        Coordinate("alpha3", -6.0, -0.5),
    )

    def from_coordinates(self, x: Array) -> Array:
        """Return the parameters mu_p and alpha_p, (P, 6), from coordinates of the search, (P, 6).

        The coordinates are mu0, w_1, w_2/(1 - w_1) and the exponents, with the initial shear modulus mu0 and the
        fractions w_p = mu_p alpha_p/(2 mu0).
        """
        first = x[:, 1]
        shares = np.column_stack([first, (1 - first) * x[:, 2], (1 - first) * (1 - x[:, 2])])
        alpha = x[:, 3:6]
        mu = 2 * x[:, :1] * shares / alpha
        return np.stack([mu, alpha], axis=-1).reshape(len(x), 6)

    def initial_shear_modulus(self, parameters: Array) -> Array:
        """Return the initial shear modulus of the Ogden law, half the sum of mu_p alpha_p over its three terms."""
        return 0.5 * np.sum(parameters[..., 0::2] * parameters[..., 1::2], axis=-1)

    def planar(self, parameters: Array, a: Array, J: Array, section: Section) -> PlanarEnergy:
        """Return the strain energy density and its derivatives by a = F : F and J = det F.

        F is the deformation gradient in the plane.
        """
        over_J = 1 / J
        c = 0.5 * a * over_J
        log_J = np.log(J)
        value, by_a, by_J, by_aa, by_aJ, by_JJ = (np.zeros_like(c) for _ in range(6))  # powers of J follow
        for p in range(3):
            mu, alpha = parameters[..., 2 * p], parameters[..., 2 * p + 1]
            # The in-plane stretches contribute 2 J^beta g(c), the third stretch contributes J^-gamma.
            beta, gamma = (alpha / 2, alpha) if section == "plane-stress" else (alpha / 6, alpha / 3)
            g, g1, g2 = _cosh_of_scaled_angle(alpha / 2, c)
            scale = mu / alpha
            power = np.exp(beta * log_J)
            in_plane = scale * power
            third = scale / (power * power)  # gamma is twice beta
            slope = beta * g - c * g1
            mixed = (beta - 1) * g1 - c * g2
            value += 2 * (in_plane * g) + (third - 3 * scale)
            by_a += in_plane * g1
            by_J += 2 * (in_plane * slope) - gamma * third
            by_aa += in_plane * g2
            by_aJ += in_plane * mixed
            by_JJ += 2 * (in_plane * ((beta - 1) * slope - c * mixed)) + (gamma * (gamma + 1)) * third
        over_J2 = over_J * over_J
        return PlanarEnergy(
            value, by_a * over_J, by_J * over_J, 0.5 * by_aa * over_J2, by_aJ * over_J2, by_JJ * over_J2
        )

    def principal(self, parameters: Array, stretches: Array) -> tuple[Array, Array, Array]:
        """Return the strain energy, and its gradient and Hessian by the logarithmic principal stretches."""
        mu, alpha = parameters[..., None, 0::2], parameters[..., None, 1::2]
        powers = stretches[..., :, None] ** alpha
        energy = np.sum(mu / alpha * (powers - 1), axis=(-1, -2))
        gradient = np.sum(mu * powers, axis=-1)
        diagonal = np.sum(mu * alpha * powers, axis=-1)
        return energy, gradient, diagonal[..., None] * np.eye(3)

    def drucker_limit(self, parameters: Array, largest_stretch: Array) -> Array:
        """Return the stretch up to which the law is proved stable, for P sets of parameters, (P,).

        The result is 0 if the law is unstable at rest. If mu_p alpha_p is not negative in any term p, the result is
        infinity; otherwise it is at most ``largest_stretch``.
        """
        alpha = parameters[:, 1::2]
        weight = parameters[:, 0::2] * alpha
        limit = np.where(weight.sum(axis=1) > 0, np.inf, 0.0)
        doubtful = np.flatnonzero((limit > 0) & (weight < 0).any(axis=1))
        if len(doubtful):
            limit[doubtful] = np.exp(
                proved_stable(weight[doubtful], alpha[doubtful], np.log(largest_stretch[doubtful]))
            )
        return limit

    def fit_stress(self, strain: Array, stress: Array, weight: Array) -> StressFit:
        """Fit the Ogden law to a tensile curve: the exponents by a search, the moduli by linear least squares."""
        return _least_squares(self, strain, stress, weight)

    def card(self, solver: str, p: Mapping[str, float], bulk: float) -> CardConstants:
        """Return the constants of the Ogden law for a finite-element program.

        Raises NotInSolver for SOFA if more than one modulus differs from zero.
        """
        values = list(p.values())
        terms = list(enumerate(zip(values[0::2], values[1::2], strict=True), 1))
        match solver:
            case "abaqus" | "calculix":
                constants: dict[str, float] = {}
                for i, (mu, alpha) in terms:
                    constants |= {f"mu{i}": mu * alpha / 2, f"alpha{i}": alpha}
                note = "card: W = sum 2 mu_i/alpha_i^2 (...), mu_i = mu_p alpha_p / 2 of the law above; "
                note += "constants mu1, alpha1, ..., D1, D2, D3"
                return CardConstants("OGDEN, N=3", constants | {"D1": 2 / bulk, "D2": 0.0, "D3": 0.0}, notes=[note])
            case "ansys":
                return CardConstants("TB,HYPER,1,1,3,OGDEN", {**p, "d": 2 / bulk})
            case "comsol":
                return CardConstants("", p, dimensionless=["alpha1", "alpha2", "alpha3"])
            case "febio":
                tags: dict[str, float] = {}
                for i, (mu, alpha) in terms:
                    tags |= {f"c{i}": mu * alpha, f"m{i}": alpha}
                return CardConstants("Ogden", tags, notes=["card: W = sum c_i/m_i^2 (...), c_i = mu_p alpha_p"])
            case "sofa":
                nonzero = [(mu, alpha) for _, (mu, alpha) in terms if mu != 0]
                if len(nonzero) != 1:
                    raise NotInSolver(
                        f"sofa has an ogden law with one term only, but this law has {len(nonzero)} terms"
                    )
                (mu, alpha) = nonzero[0]
                return CardConstants(
                    "Ogden",
                    {"mu1": mu * alpha, "alpha1": alpha, "k0": bulk},
                    notes=[
                        "card: W = mu1/alpha1^2 (...), mu1 = mu_p alpha_p",
                        "this card needs SOFA v25.12 or later (pull request 5748): the Ogden law of earlier versions "
                        "fails SOFA's own tests, and its ParameterSet has another order, k0 mu1 alpha1",
                        "the component beside HyperelasticityFEMForceField is OgdenMaterial with mu = mu1, "
                        "alpha = alpha1, kappa = k0",
                    ],
                )
            case _:
                raise NotInSolver(f"the ogden law cannot be exported to {solver}; choose another program")


def _stress_of_terms(law: Law, exponents: Array, strain: Array) -> Array:
    """Return the engineering stress of each Ogden term at m strains for a shear modulus of 1, (m, 3)."""
    parameters = np.zeros((3, 6))
    parameters[:, 1::2] = exponents
    parameters[np.arange(3), 2 * np.arange(3)] = 2 / exponents
    return engineering_stress(law, parameters, strain).T


def _least_squares(law: Law, strain: Array, stress: Array, weight: Array) -> StressFit:
    """Fit the Ogden law to a tensile curve: search the exponents, and compute the moduli by least squares."""
    # Without bounds of the exponents and non-negative contributions mu_p alpha_p / 2 (Hill), different sets of three
    # terms can fit a curve equally well (Ogden, Saccomandi and Sgura 2004, Comput. Mech. 34:484).
    lower = np.array([c.lower for c in law.coordinates[-3:]])
    upper = np.array([c.upper for c in law.coordinates[-3:]])
    target = weight * stress

    def shares_of(exponents: Array) -> tuple[Array, Array]:
        terms = weight[:, None] * _stress_of_terms(law, exponents, strain)
        size = np.linalg.norm(terms, axis=0)
        shares = scipy.optimize.nnls(terms / size, target)[0] / size
        return shares, terms @ shares - target

    scale = np.linalg.norm(target)
    fractions = (np.arange(_STARTS_EACH) + 0.5) / _STARTS_EACH
    searches = [
        scipy.optimize.least_squares(
            lambda exponents: shares_of(exponents)[1] / scale,
            lower + np.array(start) * (upper - lower),
            bounds=(lower, upper),
            x_scale=upper - lower,
            max_nfev=100,
        )
        for start in product(fractions, repeat=3)
    ]
    exponents: Array = min(searches, key=lambda result: float(result.cost)).x
    shares, residual = shares_of(exponents)
    if not shares.any():
        raise CannotFit("no stable ogden law has stresses of this sign: check the signs of strain and stress")
    parameters = np.column_stack([2 * shares / exponents, exponents]).ravel()
    return _with_intervals(law, parameters, strain, residual, weight, np.column_stack([lower, upper]))


def _with_intervals(
    law: Law, parameters: Array, strain: Array, residual: Array, weight: Array, ranges: Array
) -> StressFit:
    """Return the tensile fit of the Ogden law with its 95 % intervals; ``ranges`` holds the bounds of the exponents."""
    # The bounds of an exponent act as a normal prior with the variance of a uniform distribution. The modulus of an
    # absent term can have any value whose effect on the curve cannot be distinguished from the noise.
    exponents = parameters[1::2]
    shares = 0.5 * parameters[0::2] * exponents
    present = np.flatnonzero(shares > 0)
    terms = weight[:, None] * _stress_of_terms(law, exponents, strain)
    step = 1e-5  # small beside an exponent, which is about 1
    slopes = (
        weight[:, None]
        * shares
        * (_stress_of_terms(law, exponents + step, strain) - _stress_of_terms(law, exponents - step, strain))
        / (2 * step)
    )
    k = len(present)
    prior_variance = (ranges[:, 1] - ranges[:, 0]) ** 2 / 12
    information = np.diag(np.concatenate([np.zeros(k), 1 / prior_variance[present]]))
    covariance, t, tau = covariance_of(np.column_stack([terms[:, present], slopes[:, present]]), residual, information)
    spread = np.sqrt(np.diag(covariance))
    intervals = np.empty((6, 2))
    held = [True] * 6
    intervals[1::2] = ranges
    for place, p in enumerate(present):
        low, high = exponents[p] + t * spread[k + place] * np.array([-1, 1])
        intervals[2 * p + 1] = max(low, ranges[p, 0]), min(high, ranges[p, 1])
        held[2 * p + 1] = bool(low <= ranges[p, 0] and high >= ranges[p, 1])
        # Linearise mu = 2 share / alpha.
        slope = np.zeros(2 * k)
        slope[place], slope[k + place] = 2 / exponents[p], -2 * shares[p] / exponents[p] ** 2
        half = t * np.sqrt(slope @ covariance @ slope)
        intervals[2 * p] = parameters[2 * p] + half * np.array([-1, 1])
        held[2 * p] = False
    variance_of_row = residual @ residual / max(len(residual) - 2 * k, 1)
    for p in np.flatnonzero(shares == 0):
        undetectable_share = t * np.sqrt(tau * variance_of_row / (terms[:, p] @ terms[:, p]))
        intervals[2 * p] = np.sort([0.0, 2 * undetectable_share / exponents[p]])
    total = np.concatenate([np.ones(k), np.zeros(k)])
    # Jacobian of (moduli, exponents) in (shares, exponents).
    jacobian = np.zeros((6, 2 * k))
    for place, p in enumerate(present):
        jacobian[2 * p, place], jacobian[2 * p, k + place] = 2 / exponents[p], -2 * shares[p] / exponents[p] ** 2
        jacobian[2 * p + 1, k + place] = 1.0
    correlation = correlation_of(jacobian @ covariance @ jacobian.T)
    return StressFit(parameters, intervals, held, float(t * np.sqrt(total @ covariance @ total)), tau, correlation)
