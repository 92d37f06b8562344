"""Drucker's stability criterion for hyperelastic laws, and the largest stretch up to which a law fulfils it.

A law is stable at a deformation if the increments of Kirchhoff stress tau and logarithmic strain eps do positive work,
d tau : d eps > 0, for every isochoric increment (Drucker 1959, J. Appl. Mech. 26:101). It is stable up to the stretch L
if it is stable at every isochoric deformation whose principal stretches do not exceed L.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.laws.law import Law

Array = NDArray[np.float64]

LARGEST_STRETCH_CHECKED = 6.0
_TOUCHING = 1e-6  # a complex pair with a smaller relative imaginary part counts as a double real root
_LEVELS, _SHARES = 48, 61  # a scan may overlook an unstable range of stretches that is narrower than ln(L)/48
_HALVINGS = 30


def stable_stretch(law: Law, parameters: Array, reached: Array) -> Array:
    """Return the stretch up to which a law fulfils Drucker's criterion, at most the stretch ``reached``.

    Parameters
    ----------
    law
        One of `LAWS`, or any other law.
    parameters
        (P, n) or (n,) parameters; moduli in any unit.
    reached
        (P,) largest principal stretch in the specimen.

    Returns
    -------
    Array
        (P,) stretches; 0 if the law is unstable at rest.

    Examples
    --------
    >>> from eimi_fitting.laws import LAWS
    >>> stable_stretch(LAWS["yeoh"], np.array([[1e4, -2e3, 0.0], [1e4, 2e3, 0.0]]), np.array([2.0, 2.0])).round(3)
    array([1.322, 2.   ])
    """
    parameters, largest_stretch = np.atleast_2d(np.asarray(parameters, float)), np.maximum(reached, 1.0)
    with np.errstate(all="ignore"):
        return np.minimum(law.drucker_limit(parameters, largest_stretch), largest_stretch)


def stable_up_to(law: Law, parameters: Array) -> float | None:
    """Return the largest stretch up to which a law fulfils Drucker's criterion.

    Parameters
    ----------
    law
        One of `LAWS`, or any other law.
    parameters
        (n,) parameters; moduli in any unit.

    Returns
    -------
    float or None
        Stretch; 1 if the law is unstable at rest; None if the law is stable up to a stretch of 6.

    Examples
    --------
    >>> from eimi_fitting.laws import LAWS
    >>> round(stable_up_to(LAWS["mooney-rivlin"], np.array([-2e3, 1e4])), 3)
    1.495
    >>> stable_up_to(LAWS["mooney-rivlin"], np.array([2e3, 1e4])) is None
    True
    """
    limit = float(stable_stretch(law, parameters, np.array([LARGEST_STRETCH_CHECKED]))[0])
    return None if limit >= LARGEST_STRETCH_CHECKED * (1 - 1e-9) else max(limit, 1.0)


def scanned_limit(law: Law, parameters: Array, largest_stretch: Array) -> Array:
    """Return the smallest stretch at which a sampled deformation is unstable (Drucker).

    Parameters
    ----------
    law
        Hyperelastic law.
    parameters
        (P, n) P sets of parameters.
    largest_stretch
        (P,) stretches up to which deformations are sampled.

    Returns
    -------
    Array
        (P,) stretches: infinity if all sampled deformations are stable, 0 if the law is unstable at rest.
    """
    levels = np.log(largest_stretch)[:, None] * np.arange(1, _LEVELS + 1) / _LEVELS
    stable = np.stack([_is_stable_at(law, parameters, levels[:, i]) for i in range(_LEVELS)], axis=1)
    limit = np.where(law.initial_shear_modulus(parameters) > 0, np.inf, 0.0)
    unstable = np.flatnonzero((limit > 0) & ~stable.all(axis=1))
    first = np.argmin(stable[unstable], axis=1)
    high = levels[unstable, first]
    low = np.where(first > 0, levels[unstable, first - 1], 0.0)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        holds = _is_stable_at(law, parameters[unstable], middle)
        low, high = np.where(holds, middle, low), np.where(holds, high, middle)
    limit[unstable] = np.exp(low)
    return np.asarray(limit)


def _is_stable_at(law: Law, parameters: Array, largest: Array) -> NDArray[np.bool_]:
    """Return whether a law is stable in sampled deformations, for P sets of parameters, (P,).

    largest: logarithm of the largest stretch of these deformations, (P,).
    """
    share = np.linspace(-0.5, 1.0, _SHARES)
    level = np.broadcast_to(largest[:, None], (len(largest), _SHARES))
    states = np.stack([level, level * share, -level * (1 + share)], axis=-1)
    _, _, h = law.principal(parameters[:, None, :], np.exp(states))
    # Entries of the restricted Hessian in the basis (1, -1, 0)/sqrt(2), (1, 1, -2)/sqrt(6).
    first = (h[..., 0, 0] + h[..., 1, 1] - 2 * h[..., 0, 1]) / 2
    second = (h[..., 0, 0] + h[..., 1, 1] + 4 * h[..., 2, 2] + 2 * h[..., 0, 1]) / 6 - 2 / 3 * (
        h[..., 0, 2] + h[..., 1, 2]
    )
    mixed = (h[..., 0, 0] - h[..., 1, 1] - 2 * h[..., 0, 2] + 2 * h[..., 1, 2]) / np.sqrt(12)
    return np.asarray(((first + second > 0) & (first * second - mixed**2 > 0)).all(axis=1))


def smallest_positive_root(coefficients: Array) -> Array:
    """Return the smallest positive root of each of P polynomials of degree m.

    Parameters
    ----------
    coefficients
        (P, m + 1) coefficients of the powers 0 to m.

    Returns
    -------
    Array
        (P,) roots: infinity without a positive root, 0 if the constant term is not positive.
    """
    p, m = len(coefficients), coefficients.shape[1] - 1
    size = np.abs(coefficients).max(axis=1, initial=0.0)
    sound = np.isfinite(size) & (coefficients[:, 0] > 1e-12 * size)
    reversed_monic = np.zeros((p, m))  # the polynomial in 1/x: its roots are the reciprocals of the roots
    reversed_monic[sound] = coefficients[sound, 1:] / coefficients[sound, :1]
    companion = np.zeros((p, m, m))
    companion[:, 0] = -reversed_monic
    companion[:, np.arange(1, m), np.arange(m - 1)] = 1.0
    roots = np.linalg.eigvals(companion)
    real = np.where(np.abs(roots.imag) <= _TOUCHING * np.abs(roots), roots.real, 0.0).max(axis=1)
    # A smaller reciprocal is the rounding error of a root at infinity.
    has_root = real > 1e-12 * np.abs(reversed_monic).max(axis=1, initial=1.0)
    return np.where(sound, np.where(has_root, 1 / np.where(has_root, real, 1.0), np.inf), 0.0)
