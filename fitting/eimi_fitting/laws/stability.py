"""Drucker's stability: does more strain always take more stress, over the deformations that the specimen reaches?

A law is stable at a deformation when the increments of Kirchhoff stress and logarithmic strain do positive work,
d tau : d eps > 0, for every isochoric increment: the Hessian of the energy in the logarithmic principal stretches,
restricted to increments whose sum is zero, must be positive definite (Drucker 1959, J. Appl. Mech. 26:101).

Asked here of every isochoric deformation in which no principal stretch exceeds a given one, L: a triangle in the
logarithmic stretches, whose corners are equibiaxial tension L, the middles of its sides uniaxial tension L.

Each law knows the largest such L: exactly where its algebra gives it, else from a scan of the triangle.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.laws.law import Law

Array = NDArray[np.float64]

LARGEST_STRETCH_CHECKED = 6.0
_TOUCHING = 1e-6  # imaginary part, relative, below which a pair of complex roots counts as a double real one
_LEVELS, _SHARES = 48, 61  # states of a scan: a pocket narrower than 1/48 of the logarithm of L may be stepped over
_HALVINGS = 30


def stable_stretch(law: Law, parameters: Array, reached: Array) -> Array:
    """The largest stretch, up to the one reached, to which candidates are stable in the sense of Drucker.

    Parameters
    ----------
    law
        One of `LAWS`, or any other.
    parameters
        (P, n) of P candidates, or (n,) of one, moduli in any unit.
    reached
        (P,) largest principal stretch of the specimen, of each candidate.

    Returns
    -------
    (P,) stretches, ``reached`` where no limit was met on the way; 0 where a law is not even stable at rest.

    Examples
    --------
    >>> from eimi_fitting.laws import LAWS
    >>> stable_stretch(LAWS["yeoh"], np.array([[1e4, -2e3, 0.0], [1e4, 2e3, 0.0]]), np.array([2.0, 2.0])).round(3)
    array([1.322, 2.   ])
    """
    parameters, most = np.atleast_2d(np.asarray(parameters, float)), np.maximum(reached, 1.0)
    with np.errstate(all="ignore"):
        return np.minimum(law.drucker_limit(parameters, most), most)


def stable_up_to(law: Law, parameters: Array) -> float | None:
    """The largest stretch up to which one candidate is stable in the sense of Drucker.

    Parameters
    ----------
    law
        One of `LAWS`, or any other.
    parameters
        (n,), moduli in any unit.

    Returns
    -------
    The stretch, 1 for a law that is not even stable at rest; None where no limit was met up to 6.

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


def scanned_limit(law: Law, parameters: Array, most: Array) -> Array:
    """(P, n) and (P,) -> (P,): `Law.drucker_limit` from the definition alone, for a law without an exact criterion.

    48 levels of the largest stretch, 61 states at each, from uniaxial over planar to equibiaxial tension; the first
    level that holds an unstable state is then found by halving. What lies between the states is not looked at.
    """
    levels = np.log(most)[:, None] * np.arange(1, _LEVELS + 1) / _LEVELS
    stable = np.stack([_stable_level(law, parameters, levels[:, i]) for i in range(_LEVELS)], axis=1)
    limit = np.where(law.initial_shear_modulus(parameters) > 0, np.inf, 0.0)
    lost = np.flatnonzero((limit > 0) & ~stable.all(axis=1))
    first = np.argmin(stable[lost], axis=1)
    high = levels[lost, first]
    low = np.where(first > 0, levels[lost, first - 1], 0.0)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        holds = _stable_level(law, parameters[lost], middle)
        low, high = np.where(holds, middle, low), np.where(holds, high, middle)
    limit[lost] = np.exp(low)
    return np.asarray(limit)


def _stable_level(law: Law, parameters: Array, largest: Array) -> NDArray[np.bool_]:
    """(P, n) and (P,) -> (P,): whether all states with this logarithm of the largest stretch are stable."""
    share = np.linspace(-0.5, 1.0, _SHARES)
    level = np.broadcast_to(largest[:, None], (len(largest), _SHARES))
    states = np.stack([level, level * share, -level * (1 + share)], axis=-1)
    _, _, h = law.principal(parameters[:, None, :], np.exp(states))
    # On the increments (1, -1, 0) / sqrt(2) and (1, 1, -2) / sqrt(6), whose sums are zero.
    one = (h[..., 0, 0] + h[..., 1, 1] - 2 * h[..., 0, 1]) / 2
    other = (h[..., 0, 0] + h[..., 1, 1] + 4 * h[..., 2, 2] + 2 * h[..., 0, 1]) / 6 - 2 / 3 * (
        h[..., 0, 2] + h[..., 1, 2]
    )
    mixed = (h[..., 0, 0] - h[..., 1, 1] - 2 * h[..., 0, 2] + 2 * h[..., 1, 2]) / np.sqrt(12)
    return np.asarray(((one + other > 0) & (one * other - mixed**2 > 0)).all(axis=1))


def smallest_positive_root(coefficients: Array) -> Array:
    """(P, m + 1) in rising order -> (P,): smallest root above zero, infinity without one, zero unless [:, 0] > 0."""
    p, m = len(coefficients), coefficients.shape[1] - 1
    size = np.abs(coefficients).max(axis=1, initial=0.0)
    sound = np.isfinite(size) & (coefficients[:, 0] > 1e-12 * size)
    reversed_monic = np.zeros((p, m))  # of the polynomial whose roots are the reciprocals
    reversed_monic[sound] = coefficients[sound, 1:] / coefficients[sound, :1]
    companion = np.zeros((p, m, m))
    companion[:, 0] = -reversed_monic
    companion[:, np.arange(1, m), np.arange(m - 1)] = 1.0
    roots = np.linalg.eigvals(companion)
    real = np.where(np.abs(roots.imag) <= _TOUCHING * np.abs(roots), roots.real, 0.0).max(axis=1)
    found = real > 1e-12 * np.abs(reversed_monic).max(axis=1, initial=1.0)  # less is rounding of a root at infinity
    return np.where(sound, np.where(found, 1 / np.where(found, real, 1.0), np.inf), 0.0)
