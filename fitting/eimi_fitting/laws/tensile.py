"""The conventional route: a law fitted to a uniaxial tensile test by least squares on the engineering stress.

In incompressible uniaxial tension the logarithmic strains are (h, -h/2, -h/2), so the engineering stress is
dW/dlambda = (g1 - (g2 + g3) / 2) / lambda, with g the gradient of the energy in the logarithmic stretches.

All laws are linear in their moduli. One that is linear in every parameter is a linear least-squares problem, without
constraints. For any other the modulus is the least-squares one for the ratios, and the ratios are searched from several
starts within the bounds in which the identification searches.

Intervals come from the linearised covariance. Residuals of a tensile curve are mostly the law's misfit and so
correlated along the curve: n rows count as n / tau, as in `eimi_fitting.correlation`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy import special

from eimi_fitting.correlation import correlation_length
from eimi_fitting.laws.law import CannotFit, Law, StressFit
from eimi_fitting.laws.stability import stable_up_to

Array = NDArray[np.float64]

_STARTS_EACH = 2  # starting values of each ratio
_STEP = 1e-5  # of a coordinate, as a share of its range: half the digits of the modulus are left


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


def engineering_stress(law: Law, parameters: Array, strain: Array) -> Array:
    """Engineering stress of an incompressible law in uniaxial tension.

    Parameters
    ----------
    law
        One of `LAWS`, or any other.
    parameters
        (..., n), one candidate or many.
    strain
        (m,) engineering strains above -1.

    Returns
    -------
    (..., m) stresses in the unit of the moduli.

    Examples
    --------
    >>> from eimi_fitting.laws import LAWS
    >>> engineering_stress(LAWS["neo-hookean"], np.array([46e3]), np.array([0.0, 0.5, 1.0])).round()
    array([    0., 48556., 80500.])
    """
    stretch = 1 + strain
    stretches = np.stack([stretch, stretch**-0.5, stretch**-0.5], axis=-1)
    _, gradient, _ = law.principal(parameters[..., None, :], stretches)
    return np.asarray((gradient[..., 0] - 0.5 * (gradient[..., 1] + gradient[..., 2])) / stretch)


def fit_tensile(
    law: Law,
    strain: Array,
    stress_Pa: Array,
    *,
    largest_strain: float = np.inf,
    relative: bool = False,
) -> TensileFit:
    """Fit a law to a uniaxial tensile test by least squares on the engineering stress.

    Parameters
    ----------
    law
        One of `LAWS`, or any other.
    strain, stress_Pa
        (m,) engineering strains, and engineering stresses in Pa.
    largest_strain
        Rows beyond it are not looked at.
    relative
        Divide each residual by its measured stress, and leave out rows without a positive stress.

    Returns
    -------
    Parameters in Pa with their 95 % intervals, and what the fit is worth.

    Raises
    ------
    CannotFit
        There are no more rows than parameters, or the law cannot have such stresses.

    Examples
    --------
    >>> from eimi_fitting.laws import LAWS
    >>> strain = np.linspace(0.05, 0.5, 10)
    >>> stress = 46e3 * ((1 + strain) - (1 + strain) ** -2)
    >>> fit_tensile(LAWS["neo-hookean"], strain, stress).parameters.round(3)
    array([46000.])
    """
    window = strain <= largest_strain
    used = window & (stress_Pa > 0) if relative else window
    n = len(law.parameter_names)
    if used.sum() <= n:
        raise CannotFit(f"{used.sum()} rows can be used; a {law.name} fit needs at least {n + 1}")
    e, s = strain[used], stress_Pa[used]
    solved = law.fit_stress(e, s, 1 / s if relative else np.ones_like(s))
    residual = engineering_stress(law, solved.parameters, e) - s
    modulus = float(law.initial_shear_modulus(solved.parameters))
    half = solved.modulus_half_width
    not_fixed = tuple(
        name
        for name, (low, high), held in zip(law.parameter_names, solved.intervals, solved.held_by_bounds, strict=True)
        if held or low <= 0 <= high
    )
    return TensileFit(
        law=law,
        parameters=solved.parameters,
        intervals=solved.intervals,
        initial_shear_modulus_Pa=modulus,
        initial_shear_modulus_interval_Pa=(modulus - half, modulus + half),
        rmse_Pa=float(np.sqrt(np.mean(residual**2))),
        rows=int(used.sum()),
        rows_left_out=int(window.sum() - used.sum()),
        max_strain=float(e.max()),
        correlation_rows=solved.correlation_rows,
        correlation=solved.correlation,
        not_fixed=not_fixed,
        stable_to=stable_up_to(law, solved.parameters),
    )


def linear_least_squares(law: Law, strain: Array, stress: Array, weight: Array) -> StressFit:
    """`Law.fit_stress` of a law that is linear in all its parameters: without bounds or constraints."""
    columns = _columns(law, strain, weight)
    size = np.linalg.norm(columns, axis=0)
    parameters = np.linalg.lstsq(columns / size, weight * stress, rcond=None)[0] / size
    covariance, t, tau = covariance_of(columns, columns @ parameters - weight * stress)
    half = t * np.sqrt(np.diag(covariance))
    # The initial shear modulus is linear in the parameters too.
    slope = law.initial_shear_modulus(np.eye(len(parameters)))
    return StressFit(
        parameters,
        np.column_stack([parameters - half, parameters + half]),
        [False] * len(parameters),
        float(t * np.sqrt(slope @ covariance @ slope)),
        tau,
        correlation_of(covariance),
    )


def bounded_least_squares(law: Law, strain: Array, stress: Array, weight: Array) -> StressFit:
    """`Law.fit_stress` of any law: its modulus by linear least squares, its other coordinates within their bounds.

    In the intervals the range of a coordinate enters as a normal prior of its variance. A number without a unit goes
    from one end of its coordinates' intervals to the other, no further than their bounds.
    """
    from scipy import optimize  # slow to load, and of no use to a beam

    ratios = law.coordinates[1:]
    lower, upper = np.array([c.lower for c in ratios]), np.array([c.upper for c in ratios])
    target = weight * stress
    if not target.any():
        raise CannotFit("every stress is zero")

    def curve(x: Array) -> Array:
        return weight * engineering_stress(law, law.from_coordinates(x[None]), strain)[0]

    def modulus_of(at: Array) -> tuple[float, Array]:
        unit = curve(np.concatenate([[1.0], at]))
        modulus = max(float(unit @ target / (unit @ unit)), 0.0)
        return modulus, modulus * unit - target

    fractions = (np.arange(_STARTS_EACH) + 0.5) / _STARTS_EACH
    found = [
        optimize.least_squares(
            lambda at: modulus_of(at)[1] / np.linalg.norm(target),
            lower + np.array(start) * (upper - lower),
            bounds=(lower, upper),
            x_scale=upper - lower,
            max_nfev=100,
        )
        for start in product(fractions, repeat=len(ratios))
    ]
    best: Array = min(found, key=lambda result: float(result.cost)).x
    modulus, residual = modulus_of(best)
    if modulus == 0.0:
        raise CannotFit(f"no {law.name} law within the bounds of the search has stresses of this sign")
    return _bounded_worth(law, np.concatenate([[modulus], best]), curve, residual, lower, upper)


def _bounded_worth(
    law: Law, x: Array, curve: Callable[[Array], Array], residual: Array, lower: Array, upper: Array
) -> StressFit:
    """Intervals about coordinates (m,), from the covariance of coordinates turned into that of parameters."""

    def parameters_at(at: Array) -> Array:
        return law.from_coordinates(at[None])[0]

    # Differences within the bounds: beyond them the law may not exist.
    step = _STEP * np.concatenate([x[:1], upper - lower])
    centre = np.concatenate([x[:1], np.clip(x[1:], lower + step[1:], upper - step[1:])])
    pairs = [(centre + row, centre - row) for row in np.diag(step)]
    jacobian = np.column_stack([(curve(up) - curve(down)) / (2 * s) for (up, down), s in zip(pairs, step, strict=True)])
    turn = np.column_stack(
        [(parameters_at(up) - parameters_at(down)) / (2 * s) for (up, down), s in zip(pairs, step, strict=True)]
    )
    information = np.diag(np.concatenate([[0.0], 12 / (upper - lower) ** 2]))
    covariance, t, tau = covariance_of(jacobian, residual, information)
    half_x = t * np.sqrt(np.diag(covariance))
    loose = np.concatenate([[False], (x[1:] - half_x[1:] <= lower) & (x[1:] + half_x[1:] >= upper)])
    parameters, own = parameters_at(x), turn @ covariance @ turn.T
    half = t * np.sqrt(np.diag(own))
    ends = zip(np.maximum((x - half_x)[1:], lower), np.minimum((x + half_x)[1:], upper), strict=True)
    corners = law.from_coordinates(np.array([[x[0], *corner] for corner in product(*ends)]))
    plain = np.array([unit == "1" for unit in law.units])
    low = np.where(plain, corners.min(axis=0), parameters - half)
    high = np.where(plain, corners.max(axis=0), parameters + half)
    from_bounds = turn[:, loose] ** 2 @ np.diag(covariance)[loose]  # variance that only the bounds limit
    return StressFit(
        parameters=parameters,
        intervals=np.column_stack([low, high]),
        held_by_bounds=[bool(held) for held in from_bounds > 0.5 * np.diag(own)],
        modulus_half_width=float(half_x[0]),
        correlation_rows=tau,
        correlation=correlation_of(own),
    )


def _columns(law: Law, strain: Array, weight: Array) -> Array:
    """(m, n): weighted engineering stress for a unit of each parameter of a law that is linear in all of them."""
    return weight[:, None] * engineering_stress(law, np.eye(len(law.parameter_names)), strain).T


def covariance_of(jacobian: Array, residual: Array, information: Array | None = None) -> tuple[Array, float, float]:
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


def correlation_of(covariance: Array) -> Array:
    """(n, n) of a covariance (n, n); a parameter without a variance is correlated with itself alone."""
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    known = np.where(spread > 0, spread, 1.0)
    correlation = covariance / np.outer(known, known)
    np.fill_diagonal(correlation, 1.0)
    return np.asarray(correlation)
