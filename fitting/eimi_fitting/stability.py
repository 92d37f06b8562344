"""Drucker's stability: does more strain always take more stress, over the deformations that the specimen reaches?

A law is stable at a deformation when the increments of Kirchhoff stress and logarithmic strain do positive work,
d tau : d eps > 0, for every isochoric increment: the Hessian of the energy in the logarithmic principal stretches,
restricted to increments whose sum is zero, must be positive definite (Drucker 1959, J. Appl. Mech. 26:101).

Asked here of every isochoric deformation in which no principal stretch exceeds a given one, L: a triangle in the
logarithmic stretches, whose corners are equibiaxial tension L, the middles of its sides uniaxial tension L.

Mooney-Rivlin and Yeoh: exact. With q_i = lambda_i^2 and q1 q2 q3 = 1 the determinant of the restricted Hessian is,
up to a positive factor,

    Mooney-Rivlin  C10^2 I2 + C01^2 I1 + C10 C01 (I1 I2 - 3)
    Yeoh           W' (W' I2 + W'' (I1 I2 - 9))

A negative C01 or C10 makes the first fall with I1 and I2 wherever it could vanish; a negative W'' makes the second fall
with I2 at a given I1. I1 and I2 are convex in the logarithmic stretches, and no state of a given I1 has a larger I2,
or a smaller largest stretch, than the equibiaxial one. So stability is lost in equibiaxial tension first, and what is
left is the smallest root of a polynomial in one unknown.

Ogden: the Hessian is diagonal, f(ln lambda_i) with f(e) = sum of mu_p alpha_p exp(alpha_p e), and the restricted form
only grows with each entry. Lower bounds of f on intervals therefore prove stability of whole cells of the triangle
(tangents below the convex terms, chords below the concave ones); cells that are not proved are divided. An unstable
pocket cannot hide between points; what remains unproved counts as unstable.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from eimi_fitting.materials import Law

Array = NDArray[np.float64]

LARGEST_STRETCH_CHECKED = 6.0
_ROWS, _COLUMNS = 8, 12  # cells of the triangle to begin with
_SPLITS = 16  # of a cell, at most: the limit is then found within 4e-6 in its logarithm
_MOST_CELLS = 100_000
_TOUCHING = 1e-6  # imaginary part, relative, below which a pair of complex roots counts as a double real one


def _yeoh_stiffness() -> Array:
    """(10, 3): coefficients in s = q - 1 of W' I2 + W'' (I1 I2 - 9), times q^5, in equibiaxial tension.

    There I1 - 3 = X/q^2 with X = 2 q^3 - 3 q^2 + 1, I2 = (q^3 + 2)/q and I1 I2 - 9 = 2 (q^3 - 1)^2/q^3.
    """
    q = Polynomial([1.0, 1.0])
    x = 2 * q**3 - 3 * q**2 + 1
    second, growth = q**3 + 2, 2 * (q**3 - 1) ** 2
    columns = (
        q**4 * second,
        2 * x * q**2 * second + 2 * q**2 * growth,
        3 * x**2 * second + 6 * x * growth,
    )
    return np.stack([np.pad(c.coef, (0, 10 - len(c.coef))) for c in columns], axis=1)


_YEOH = _yeoh_stiffness()


def _smallest_positive_root(coefficients: Array) -> Array:
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


def _neo_hookean(parameters: Array, most: Array) -> Array:
    """Everywhere or nowhere."""
    return np.where(parameters[:, 0] > 0, np.inf, 0.0)


# C10 (q^3 + 2) + C01 (2 q^4 + q) in s = q - 1.
_MOONEY_RIVLIN = np.array([[3.0, 3.0], [3.0, 9.0], [3.0, 12.0], [1.0, 8.0], [0.0, 2.0]])


def _mooney_rivlin(parameters: Array, most: Array) -> Array:
    """In equibiaxial tension the stress falls (C01 < 0), or equal stretches part: C10 q + C01/q = 0 (C10 < 0)."""
    c10, c01 = parameters.T
    limit = np.full(len(parameters), np.inf)
    parting, falling = c10 < 0, c01 < 0
    limit[parting] = np.abs(c01[parting] / c10[parting]) ** 0.25
    limit[falling] = np.sqrt(1 + _smallest_positive_root(parameters[falling] @ _MOONEY_RIVLIN.T))
    return np.where(c10 + c01 > 0, limit, 0.0)


def _yeoh(parameters: Array, most: Array) -> Array:
    """In equibiaxial tension the stress falls."""
    limit = np.full(len(parameters), np.inf)
    doubtful = (parameters[:, 1:] < 0).any(axis=1)
    limit[doubtful] = np.sqrt(1 + _smallest_positive_root(parameters[doubtful] @ _YEOH.T))
    return np.where(parameters[:, 0] > 0, limit, 0.0)


def _ogden(parameters: Array, most: Array) -> Array:
    """Everywhere with positive mu_p alpha_p (Hill 1970, J. Mech. Phys. Solids 18:457), else as far as is proved."""
    alpha = parameters[:, 1::2]
    weight = parameters[:, 0::2] * alpha
    limit = np.where(weight.sum(axis=1) > 0, np.inf, 0.0)
    doubtful = np.flatnonzero((limit > 0) & (weight < 0).any(axis=1))
    if len(doubtful):
        limit[doubtful] = np.exp(_proved(weight[doubtful], alpha[doubtful], np.log(most[doubtful])))
    return limit


def _proved(weight: Array, alpha: Array, most: Array) -> Array:
    """(P, 3), (P, 3), (P,) -> (P,): logarithm of the stretch up to which every cell of the triangle is proved stable.

    A state is (l, l s, -l (1 + s)) with the largest stretch l and s from -1/2 (uniaxial tension) over 0 (planar) to 1
    (equibiaxial); cells are intervals of both, split into four until they are proved or no longer matter.
    """
    p = len(most)
    owner = np.repeat(np.arange(p), _ROWS * _COLUMNS)
    row = np.tile(np.repeat(np.arange(_ROWS), _COLUMNS), p) / _ROWS * most[owner]
    share = np.tile(np.arange(_COLUMNS), p * _ROWS) * (1.5 / _COLUMNS) - 0.5
    height, width = most / _ROWS, 1.5 / _COLUMNS
    refuted = most.copy()
    for _ in range(_SPLITS):
        w, a = weight[owner], alpha[owner]
        start, end, left, right = row, row + height[owner], share, share + width
        proved = _definite(
            _least(w, a, start, end),
            _least(w, a, np.minimum(start * left, end * left), np.maximum(start * right, end * right)),
            _least(w, a, -end * (1 + right), -start * (1 + left)),
        )
        middle, s = 0.5 * (start + end), 0.5 * (left + right)
        points = (middle, middle * s, -middle * (1 + s))
        unstable = ~_definite(*((w * np.exp(a * e[:, None])).sum(axis=1) for e in points))
        np.minimum.at(refuted, owner[unstable], middle[unstable])
        open_cells = np.flatnonzero(~proved & (row < refuted[owner]))
        if not len(open_cells) or len(open_cells) > _MOST_CELLS:
            break
        height, width = height / 2, width / 2
        owner = np.tile(owner[open_cells], 4)
        row = (row[open_cells] + np.array([[0], [0], [1], [1]]) * height[owner[: len(open_cells)]]).ravel()
        share = (share[open_cells] + np.array([[0], [1], [0], [1]]) * width).ravel()
        open_cells = np.arange(len(owner))
    low = most.copy()
    np.minimum.at(low, owner[open_cells], row[open_cells])
    return low


def _least(weight: Array, alpha: Array, start: Array, end: Array) -> Array:
    """Lower bound of the sum of weight exp(alpha e) over e from start to end: (n, 3) and (n,) -> (n,).

    Tangents below the convex terms and chords below the concave ones add up to a line, which is least at an end.
    """
    start, end = start[..., None], end[..., None]
    first, last = weight * np.exp(alpha * start), weight * np.exp(alpha * end)
    tangent, slope = weight * np.exp(0.5 * alpha * (start + end)), 0.5 * alpha * (end - start)
    convex = weight > 0
    line = np.minimum(
        np.where(convex, tangent * (1 - slope), first).sum(axis=-1),
        np.where(convex, tangent * (1 + slope), last).sum(axis=-1),
    )
    return np.asarray(np.maximum(line, np.minimum(first, last).sum(axis=-1)))


def _definite(a: Array, b: Array, c: Array) -> NDArray[np.bool_]:
    """Whether diag(a, b, c) is positive definite on the increments whose sum is zero."""
    return np.asarray((a + b + c > 0) & (a * b + b * c + c * a > 0))


_LIMITS: dict[str, Callable[[Array, Array], Array]] = {
    "neo-hookean": _neo_hookean,
    "mooney-rivlin": _mooney_rivlin,
    "yeoh": _yeoh,
    "ogden": _ogden,
}


def stable_stretch(law: Law, parameters: Array, reached: Array) -> Array:
    """(P, n) and (P,) -> (P,): the largest stretch, up to the one reached, at which a law is stable; 0 where it is
    not even stable at rest. Raises KeyError for a law that is not one of LAWS.
    """
    parameters, most = np.atleast_2d(np.asarray(parameters, float)), np.maximum(reached, 1.0)
    with np.errstate(all="ignore"):
        return np.minimum(_LIMITS[law.name](parameters, most), most)


def stable_up_to(law: Law, parameters: Array) -> float | None:
    """Largest stretch up to which one candidate (n,) is stable, 1 for none; None where no limit was met up to 6."""
    limit = float(stable_stretch(law, parameters, np.array([LARGEST_STRETCH_CHECKED]))[0])
    return None if limit >= LARGEST_STRETCH_CHECKED * (1 - 1e-9) else max(limit, 1.0)
