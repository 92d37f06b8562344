"""Least-squares fit of a hyperelastic law to a uniaxial tensile test.

With the stretch lambda and the gradient g of the strain energy W by the logarithmic stretches, the engineering stress
of an incompressible law is

    s = dW/dlambda = (g1 - (g2 + g3)/2) / lambda.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
import scipy
from numpy.typing import NDArray

from eimi_fitting.correlation import correlation_length
from eimi_fitting.laws.law import CannotFit, Law, StressFit
from eimi_fitting.laws.stability import stable_up_to

Array = NDArray[np.float64]

_STARTS_EACH = 2  # starting values of each ratio
_STEP = 1e-5  # step of a central difference, relative to the range of the coordinate
_DEPENDENT = 1e-9  # smallest singular value of independent columns of length 1


@dataclass(frozen=True)
class TensileFit:
    """A law with n parameters, fitted to a tensile curve up to a largest strain.

    Parameters
    ----------
    law
        Hyperelastic law.
    parameters
        (n,) fitted parameters in the order of the law; moduli in Pa.
    intervals
        (n, 2) lower and upper end of the 95 % interval of each parameter.
    initial_shear_modulus_Pa, initial_shear_modulus_interval_Pa
        Initial shear modulus, and its 95 % interval.
    rmse_Pa
        Root mean square error of the engineering stress.
    rows, rows_left_out
        Number of used rows, and of rows left out because their stress is not positive.
    max_strain
        Engineering strain of the used row with the largest principal stretch.
    correlation_rows
        Correlation length of the residuals in rows.
    correlation
        (n, n) correlation matrix of the parameters.
    not_fixed
        Names of the parameters that the data do not determine.
    stable_to
        Largest stretch up to which the law is stable; None if it is stable up to a stretch of 6.
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

    @property
    def max_stretch(self) -> float:
        """The largest principal stretch of the used rows. In compression, this is the stretch across the specimen."""
        return float(_principal_stretch(np.array(self.max_strain)))


def _principal_stretch(strain: Array) -> Array:
    return np.maximum(1 + strain, (1 + strain) ** -0.5)


def strain_reached(strain: Array) -> float:
    """Return the engineering strain with the largest principal stretch in a uniaxial test; negative in compression.

    Examples
    --------
    >>> strain_reached(np.array([0.1, 0.5])), strain_reached(np.array([-0.1, -0.5]))
    (0.5, -0.5)
    """
    return float(strain[np.argmax(_principal_stretch(strain))])


def engineering_stress(law: Law, parameters: Array, strain: Array) -> Array:
    """Return the engineering stress of an incompressible law in uniaxial tension.

    Parameters
    ----------
    law
        One of `LAWS`, or any other law.
    parameters
        (..., n) parameters.
    strain
        (m,) engineering strains above -1.

    Returns
    -------
    Array
        (..., m) engineering stresses, in the unit of the moduli.

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
        One of `LAWS`, or any other law.
    strain, stress_Pa
        (m,) engineering strains, and engineering stresses in Pa.
    largest_strain
        Rows with a larger magnitude of the strain are ignored.
    relative
        Divide each residual by the measured stress, and leave out rows without a positive stress.

    Returns
    -------
    TensileFit
        Parameters with 95 % intervals, error and stability limit.

    Raises
    ------
    CannotFit
        If there are too few rows or too few different strains, or if the law cannot produce the measured stresses.

    Examples
    --------
    >>> from eimi_fitting.laws import LAWS
    >>> strain = np.linspace(0.05, 0.5, 10)
    >>> stress = 46e3 * ((1 + strain) - (1 + strain) ** -2)
    >>> fit_tensile(LAWS["neo-hookean"], strain, stress).parameters.round(3)
    array([46000.])
    """
    window = np.abs(strain) <= largest_strain
    used = window & (stress_Pa > 0) if relative else window
    n = len(law.parameter_names)
    if used.sum() <= n:
        rows = "1 row" if used.sum() == 1 else f"{used.sum()} rows"
        raise CannotFit(f"{rows} can be used, but a fit of the {law.name} law needs at least {n + 1} rows")
    e, s = strain[used], stress_Pa[used]
    if not e.any():
        raise CannotFit("every strain is zero, but a fit needs strains that are not zero")
    if not s.any():
        raise CannotFit("every stress is zero, but a fit needs stresses that are not zero")
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
        max_strain=strain_reached(e),
        correlation_rows=solved.correlation_rows,
        correlation=solved.correlation,
        not_fixed=not_fixed,
        stable_to=stable_up_to(law, solved.parameters),
    )


def linear_least_squares(law: Law, strain: Array, stress: Array, weight: Array) -> StressFit:
    """Fit a law to a tensile curve if the stress is linear in all parameters.

    Raises CannotFit if the strains do not determine all parameters, or if strain and stress have opposite signs.
    """
    if strain @ stress <= 0:
        raise CannotFit("strain and stress have opposite signs: check the signs of strain and stress")
    columns = _columns(law, strain, weight)
    size = np.linalg.norm(columns, axis=0)
    if not size.all() or np.linalg.matrix_rank(columns / size, tol=_DEPENDENT) < len(size):
        raise CannotFit(
            f"the strains do not determine the {len(size)} parameters of the {law.name} law: give at least {len(size)} "
            "clearly different strains that are not zero"
        )
    parameters = np.linalg.lstsq(columns / size, weight * stress, rcond=None)[0] / size
    covariance, t, tau = covariance_of(columns, columns @ parameters - weight * stress)
    half = t * np.sqrt(np.diag(covariance))
    # The initial shear modulus is also linear in the parameters.
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
    """Fit any law to a tensile curve: a search varies dimensionless parameters, and least squares gives the modulus."""
    bounded = law.coordinates[1:]
    lower, upper = np.array([c.lower for c in bounded]), np.array([c.upper for c in bounded])
    target = weight * stress

    def curve(x: Array) -> Array:
        return weight * engineering_stress(law, law.from_coordinates(x[None]), strain)[0]

    def modulus_and_residual(ratios: Array) -> tuple[float, Array]:
        unit = curve(np.concatenate([[1.0], ratios]))
        modulus = max(float(unit @ target / (unit @ unit)), 0.0)
        return modulus, modulus * unit - target

    fractions = (np.arange(_STARTS_EACH) + 0.5) / _STARTS_EACH
    searches = [
        scipy.optimize.least_squares(
            lambda ratios: modulus_and_residual(ratios)[1] / np.linalg.norm(target),
            lower + np.array(start) * (upper - lower),
            bounds=(lower, upper),
            x_scale=upper - lower,
            max_nfev=100,
        )
        for start in product(fractions, repeat=len(bounded))
    ]
    best: Array = min(searches, key=lambda result: float(result.cost)).x
    modulus, residual = modulus_and_residual(best)
    if modulus == 0.0:
        raise CannotFit(
            f"no {law.name} law within the bounds of the search has stresses of this sign: check the signs of strain "
            "and stress"
        )
    return _with_intervals(law, np.concatenate([[modulus], best]), curve, residual, lower, upper)


def _with_intervals(
    law: Law, x: Array, curve: Callable[[Array], Array], residual: Array, lower: Array, upper: Array
) -> StressFit:
    """Return a tensile fit with 95 % intervals.

    `x` holds the initial shear modulus and dimensionless numbers that the search varies, such as C20/C10. `curve`
    returns the weighted stress. `lower` and `upper` are the bounds of these numbers.
    """

    def parameters_at(coordinates: Array) -> Array:
        return law.from_coordinates(coordinates[None])[0]

    # Central differences stay within the bounds, because the law may not exist beyond them.
    step = _STEP * np.concatenate([x[:1], upper - lower])
    centre = np.concatenate([x[:1], np.clip(x[1:], lower + step[1:], upper - step[1:])])
    pairs = [(centre + row, centre - row) for row in np.diag(step)]
    jacobian = np.column_stack([(curve(up) - curve(down)) / (2 * s) for (up, down), s in zip(pairs, step, strict=True)])
    to_parameters = np.column_stack(  # Jacobian of the parameters in the coordinates
        [(parameters_at(up) - parameters_at(down)) / (2 * s) for (up, down), s in zip(pairs, step, strict=True)]
    )
    information = np.diag(np.concatenate([[0.0], 12 / (upper - lower) ** 2]))
    covariance, t, tau = covariance_of(jacobian, residual, information)
    half_x = t * np.sqrt(np.diag(covariance))
    loose = np.concatenate([[False], (x[1:] - half_x[1:] <= lower) & (x[1:] + half_x[1:] >= upper)])
    parameters, covariance_of_parameters = parameters_at(x), to_parameters @ covariance @ to_parameters.T
    half = t * np.sqrt(np.diag(covariance_of_parameters))
    ends = zip(np.maximum((x - half_x)[1:], lower), np.minimum((x + half_x)[1:], upper), strict=True)
    corners = law.from_coordinates(np.array([[x[0], *corner] for corner in product(*ends)]))
    dimensionless = np.array([unit == "1" for unit in law.units])
    low = np.where(dimensionless, corners.min(axis=0), parameters - half)
    high = np.where(dimensionless, corners.max(axis=0), parameters + half)
    # Part of each parameter's variance that comes from coordinates limited by their bounds alone.
    from_bounds = to_parameters[:, loose] ** 2 @ np.diag(covariance)[loose]
    return StressFit(
        parameters=parameters,
        intervals=np.column_stack([low, high]),
        held_by_bounds=[bool(held) for held in from_bounds > 0.5 * np.diag(covariance_of_parameters)],
        modulus_half_width=float(half_x[0]),
        correlation_rows=tau,
        correlation=correlation_of(covariance_of_parameters),
    )


def _columns(law: Law, strain: Array, weight: Array) -> Array:
    # The design matrix (m, n) of a linear law: the weighted stress if one parameter is 1 and the others are 0.
    return weight[:, None] * engineering_stress(law, np.eye(len(law.parameter_names)), strain).T


def covariance_of(jacobian: Array, residual: Array, information: Array | None = None) -> tuple[Array, float, float]:
    """Return the covariance of n parameters that were fitted by least squares to m correlated residuals.

    With the Jacobian J, the residuals r, the variance s² = r·r/(m - n), the correlation length tau of the residuals and
    the prior information P, the covariance is (JᵀJ/(tau s²) + P)⁻¹.

    Parameters
    ----------
    jacobian
        (m, n) derivatives of the weighted residuals, J.
    residual
        (m,) weighted residuals, r.
    information
        (n, n) inverse covariance of prior knowledge, P.

    Returns
    -------
    covariance
        (n, n) covariance.
    t
        Student's factor t for a 95 % interval, with m/tau - n (at least 1) degrees of freedom.
    tau
        Correlation length in rows.
    """
    tau = correlation_length(residual[None], np.ones((1, len(residual))))
    n = jacobian.shape[1]
    freedom = max(len(residual) / tau - n, 1.0)
    variance = max(float(residual @ residual) / max(len(residual) - n, 1), np.finfo(float).tiny)
    # Scale the columns to unit length: those of a Yeoh fit differ by ten orders of magnitude.
    size = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian / size
    normal = scaled.T @ scaled / (tau * variance)
    if information is not None:
        normal = normal + information / np.outer(size, size)
    covariance = np.linalg.pinv(normal, hermitian=True) / np.outer(size, size)
    return covariance, float(scipy.special.stdtrit(freedom, 0.975)), tau


def correlation_of(covariance: Array) -> Array:
    """Return the correlation matrix of a covariance matrix (n, n); zero for a parameter without variance."""
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    divisor = np.where(spread > 0, spread, 1.0)
    correlation = covariance / np.outer(divisor, divisor)
    np.fill_diagonal(correlation, 1.0)
    return np.asarray(correlation)
