"""The conventional route: a law fitted to a uniaxial tensile test by least squares on the engineering stress.

In incompressible uniaxial tension the logarithmic strains are (h, -h/2, -h/2), so the engineering stress is
dW/dlambda = (g1 - (g2 + g3) / 2) / lambda, with g the gradient of the energy in the logarithmic stretches.

All laws are linear in their moduli. Neo-Hookean, Mooney-Rivlin and Yeoh are therefore one linear least-squares
problem, without constraints. For Ogden the exponents are searched from several starts and the moduli are the
least-squares ones for those exponents; each term's share mu_p alpha_p / 2 of the initial shear modulus is kept
non-negative, Hill's sufficient condition for stability, and the exponents stay in the ranges in which the
identification searches: without both, three terms fitted to one curve are not unique (Ogden, Saccomandi, Sgura 2004,
Comput. Mech. 34:484).

Intervals come from the linearised covariance. Residuals of a tensile curve are mostly the law's misfit and so
correlated along the curve: n rows count as n / tau, as in `eimi_fitting.correlation`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special

from eimi_fitting.correlation import correlation_length
from eimi_fitting.materials import LAWS, Law
from eimi_fitting.search_space import SEARCH_SPACES
from eimi_fitting.stability import stable_up_to

Array = NDArray[np.float64]

_STARTS_EACH = 2  # starting values of each Ogden exponent


@dataclass(frozen=True)
class TensileFit:
    """A law fitted to one window of a tensile curve, stresses and moduli in Pa.

    parameters: (n,) and intervals: (n, 2) in the law's own order; rmse_Pa: of the engineering stress over the rows
    used; max_strain: largest engineering strain among them; correlation_rows: tau; correlation: (n, n) of the
    parameters' errors; not_fixed: parameters whose interval holds zero or is that of the search; stable_to: largest
    stretch up to which the law is stable (None: no limit met).
    """

    law: Law
    parameters: Array
    intervals: Array
    initial_shear_modulus_Pa: float
    initial_shear_modulus_interval_Pa: tuple[float, float]
    rmse_Pa: float
    rows: int
    rows_left_out: int
    max_strain: float
    correlation_rows: float
    correlation: Array
    not_fixed: tuple[str, ...]
    stable_to: float | None


class CannotFit(Exception):
    """The window holds too few rows, or stresses that the law cannot have."""


def engineering_stress(law: Law, parameters: Array, strain: Array) -> Array:
    """Engineering stress (..., m) at engineering strains (m,) of parameters (..., n), in the unit of the moduli."""
    stretch = 1 + strain
    stretches = np.stack([stretch, stretch**-0.5, stretch**-0.5], axis=-1)
    _, gradient, _ = law.principal(parameters[..., None, :], stretches)
    return np.asarray((gradient[..., 0] - 0.5 * (gradient[..., 1] + gradient[..., 2])) / stretch)


def fit_tensile(
    model: str,
    strain: Array,
    stress_Pa: Array,
    *,
    largest_strain: float = np.inf,
    relative: bool = False,
) -> TensileFit:
    """Fit a law (a key of LAWS) to engineering strain (m,) and engineering stress (m,) up to a largest strain.

    With ``relative`` each residual is divided by its measured stress, and rows without a positive stress are left out.
    Raises CannotFit and, for an unknown law, KeyError.
    """
    law = LAWS[model]
    window = strain <= largest_strain
    used = window & (stress_Pa > 0) if relative else window
    n = len(law.parameter_names)
    if used.sum() <= n:
        raise CannotFit(f"{used.sum()} rows can be used; a {model} fit needs at least {n + 1}")
    e, s = strain[used], stress_Pa[used]
    weight = 1 / s if relative else np.ones_like(s)
    solved = _ogden(law, e, s, weight) if model == "ogden" else _linear(law, e, s, weight)
    residual = engineering_stress(law, solved.parameters, e) - s
    modulus = float(law.initial_shear_modulus(solved.parameters))
    half = solved.modulus_half_width
    not_fixed = tuple(
        name
        for name, (low, high), held in zip(law.parameter_names, solved.intervals, solved.held_by_bounds, strict=True)
        if held or low <= 0 <= high
    )
    return TensileFit(
        law,
        solved.parameters,
        solved.intervals,
        modulus,
        (modulus - half, modulus + half),
        float(np.sqrt(np.mean(residual**2))),
        int(used.sum()),
        int(window.sum() - used.sum()),
        float(e.max()),
        solved.tau,
        solved.correlation,
        not_fixed,
        stable_up_to(law, solved.parameters),
    )


@dataclass(frozen=True)
class _Solved:
    """Parameters (n,), intervals (n, 2), which of them only the search's range holds, and what all of that rests on.

    correlation: (n, n) of the parameters' errors.
    """

    parameters: Array
    intervals: Array
    held_by_bounds: Sequence[bool]
    modulus_half_width: float
    tau: float
    correlation: Array


def _columns(law: Law, strain: Array, weight: Array) -> Array:
    """(m, n): weighted engineering stress for a unit of each parameter of a law that is linear in all of them."""
    return weight[:, None] * engineering_stress(law, np.eye(len(law.parameter_names)), strain).T


def _spread(jacobian: Array, residual: Array, information: Array | None = None) -> tuple[Array, float, float]:
    """Covariance (n, n), the t factor of a 95 % interval, and tau, from weighted (m, n) and (m,).

    ``information`` (n, n) is what is known of the parameters beside the data.
    """
    tau = correlation_length(residual[None], np.ones((1, len(residual))))
    n = jacobian.shape[1]
    freedom = max(len(residual) / tau - n, 1.0)
    variance = max(float(residual @ residual) / max(len(residual) - n, 1), np.finfo(float).tiny)
    # Columns of unit length: a Yeoh fit's differ by ten orders of magnitude.
    size = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian / size
    normal = scaled.T @ scaled / (tau * variance)
    if information is not None:
        normal = normal + information / np.outer(size, size)
    covariance = np.linalg.pinv(normal, hermitian=True) / np.outer(size, size)
    return covariance, float(special.stdtrit(freedom, 0.975)), tau


def _correlation(covariance: Array) -> Array:
    """(n, n) of a covariance (n, n); a parameter without a variance is correlated with itself alone."""
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    known = np.where(spread > 0, spread, 1.0)
    correlation = covariance / np.outer(known, known)
    np.fill_diagonal(correlation, 1.0)
    return np.asarray(correlation)


def _linear(law: Law, strain: Array, stress: Array, weight: Array) -> _Solved:
    columns = _columns(law, strain, weight)
    size = np.linalg.norm(columns, axis=0)
    parameters = np.linalg.lstsq(columns / size, weight * stress, rcond=None)[0] / size
    covariance, t, tau = _spread(columns, columns @ parameters - weight * stress)
    half = t * np.sqrt(np.diag(covariance))
    # The initial shear modulus is linear in the parameters too.
    slope = law.initial_shear_modulus(np.eye(len(parameters)))
    return _Solved(
        parameters,
        np.column_stack([parameters - half, parameters + half]),
        [False] * len(parameters),
        float(t * np.sqrt(slope @ covariance @ slope)),
        tau,
        _correlation(covariance),
    )


def _ogden_terms(law: Law, exponents: Array, strain: Array) -> Array:
    """(m, 3): engineering stress of each term for a share mu_p alpha_p / 2 of one."""
    parameters = np.zeros((3, 6))
    parameters[:, 1::2] = exponents
    parameters[np.arange(3), 2 * np.arange(3)] = 2 / exponents
    return engineering_stress(law, parameters, strain).T


def _ogden(law: Law, strain: Array, stress: Array, weight: Array) -> _Solved:
    space = SEARCH_SPACES["ogden"]
    lower, upper = np.array(space.lower[-3:]), np.array(space.upper[-3:])
    target = weight * stress

    def shares_of(exponents: Array) -> tuple[Array, Array]:
        terms = weight[:, None] * _ogden_terms(law, exponents, strain)
        size = np.linalg.norm(terms, axis=0)
        shares = optimize.nnls(terms / size, target)[0] / size
        return shares, terms @ shares - target

    scale = np.linalg.norm(target)
    fractions = (np.arange(_STARTS_EACH) + 0.5) / _STARTS_EACH
    found = [
        optimize.least_squares(
            lambda exponents: shares_of(exponents)[1] / scale,
            lower + np.array(start) * (upper - lower),
            bounds=(lower, upper),
            x_scale=upper - lower,
            max_nfev=100,
        )
        for start in product(fractions, repeat=3)
    ]
    exponents: Array = min(found, key=lambda result: float(result.cost)).x
    shares, residual = shares_of(exponents)
    if not shares.any():
        raise CannotFit("no stable ogden law has stresses of this sign")
    parameters = np.column_stack([2 * shares / exponents, exponents]).ravel()
    return _ogden_worth(law, parameters, strain, residual, weight, np.column_stack([lower, upper]))


def _ogden_worth(law: Law, parameters: Array, strain: Array, residual: Array, weight: Array, ranges: Array) -> _Solved:
    """Intervals of an Ogden fit.

    Shares and exponents of the terms that are there are linearised; the range of an exponent enters as a normal prior
    of its variance. A term without a share leaves its exponent free; its modulus is what the data would not notice.
    """
    exponents = parameters[1::2]
    shares = 0.5 * parameters[0::2] * exponents
    there = np.flatnonzero(shares > 0)
    terms = weight[:, None] * _ogden_terms(law, exponents, strain)
    step = 1e-5  # of an exponent, about 1
    slopes = (
        weight[:, None]
        * shares
        * (_ogden_terms(law, exponents + step, strain) - _ogden_terms(law, exponents - step, strain))
        / (2 * step)
    )
    k = len(there)
    prior_variance = (ranges[:, 1] - ranges[:, 0]) ** 2 / 12
    information = np.diag(np.concatenate([np.zeros(k), 1 / prior_variance[there]]))
    covariance, t, tau = _spread(np.column_stack([terms[:, there], slopes[:, there]]), residual, information)
    spread = np.sqrt(np.diag(covariance))
    intervals = np.empty((6, 2))
    held = [True] * 6
    intervals[1::2] = ranges
    for place, p in enumerate(there):
        low, high = exponents[p] + t * spread[k + place] * np.array([-1, 1])
        intervals[2 * p + 1] = max(low, ranges[p, 0]), min(high, ranges[p, 1])
        held[2 * p + 1] = bool(low <= ranges[p, 0] and high >= ranges[p, 1])
        # mu = 2 share / alpha, linearised.
        slope = np.zeros(2 * k)
        slope[place], slope[k + place] = 2 / exponents[p], -2 * shares[p] / exponents[p] ** 2
        half = t * np.sqrt(slope @ covariance @ slope)
        intervals[2 * p] = parameters[2 * p] + half * np.array([-1, 1])
        held[2 * p] = False
    variance_of_row = residual @ residual / max(len(residual) - 2 * k, 1)
    for p in np.flatnonzero(shares == 0):
        unnoticed = t * np.sqrt(tau * variance_of_row / (terms[:, p] @ terms[:, p]))
        intervals[2 * p] = np.sort([0.0, 2 * unnoticed / exponents[p]])
    total = np.concatenate([np.ones(k), np.zeros(k)])
    # From shares and exponents to moduli and exponents.
    turn = np.zeros((6, 2 * k))
    for place, p in enumerate(there):
        turn[2 * p, place], turn[2 * p, k + place] = 2 / exponents[p], -2 * shares[p] / exponents[p] ** 2
        turn[2 * p + 1, k + place] = 1.0
    correlation = _correlation(turn @ covariance @ turn.T)
    return _Solved(parameters, intervals, held, float(t * np.sqrt(total @ covariance @ total)), tau, correlation)
