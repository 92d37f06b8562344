"""Prove that a law is stable (Drucker) in whole ranges of deformations, if its Hessian is diagonal.

The Hessian is that of the strain energy by the three logarithmic principal stretches e_i. For a law such as Ogden's it
is diagonal with the entries f(e_i), where f(e) is the sum of terms weight exp(alpha e). The triangle of deformations
that is examined (`laws.stability`) is divided into cells. In a cell, each e_i lies in an interval. If Drucker's
criterion is fulfilled even with the lower bounds of f on the three intervals, all deformations of the cell are stable.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ROWS, _COLUMNS = 8, 12  # number of cells before the first division
_SPLITS = 16  # largest number of divisions of a cell; the logarithm of the limit is then accurate to 4e-6
_MOST_CELLS = 100_000


def proved_stable(weight: Array, alpha: Array, log_stretch: Array) -> Array:
    """Return the logarithm of the largest stretch up to which each of P candidate laws is proved stable (Drucker).

    The three principal stretches of an isochoric deformation have the logarithms l, l s and -l (1 + s). Here l belongs
    to the largest stretch, and s gives the kind of deformation: -1/2 in uniaxial tension, 0 in planar tension, 1 in
    equibiaxial tension. All deformations together form a rectangle of the plane (l, s), which is divided into smaller
    rectangles, the cells.

    A sufficient criterion can show that the law is stable in a whole cell. If it does not show this, the cell is
    divided into four smaller cells, at most 16 times. A cell is not examined if the law is known to be unstable at a
    smaller l. The result is the smallest l in the cells that the criterion does not show to be stable.

    Parameters
    ----------
    weight, alpha
        (P, 3) weights and exponents of the three terms of P candidate laws. The Hessian of the strain energy by the
        logarithms e_1, e_2, e_3 of the principal stretches is diagonal with the entries f(e_1), f(e_2), f(e_3), where
        f(e) is the sum of weight exp(alpha e) over the three terms.
    log_stretch
        (P,) logarithm of the largest stretch to examine.

    Returns
    -------
    Array
        (P,) logarithms of the stretches, at most ``log_stretch``.
    """
    p = len(log_stretch)
    owner = np.repeat(np.arange(p), _ROWS * _COLUMNS)
    row = np.tile(np.repeat(np.arange(_ROWS), _COLUMNS), p) / _ROWS * log_stretch[owner]
    share = np.tile(np.arange(_COLUMNS), p * _ROWS) * (1.5 / _COLUMNS) - 0.5
    height, width = log_stretch / _ROWS, 1.5 / _COLUMNS
    refuted = log_stretch.copy()
    for _ in range(_SPLITS):
        w, a = weight[owner], alpha[owner]
        start, end, left, right = row, row + height[owner], share, share + width
        proved = _is_positive_definite(
            _lower_bound(w, a, start, end),
            _lower_bound(w, a, np.minimum(start * left, end * left), np.maximum(start * right, end * right)),
            _lower_bound(w, a, -end * (1 + right), -start * (1 + left)),
        )
        middle, s = 0.5 * (start + end), 0.5 * (left + right)
        points = (middle, middle * s, -middle * (1 + s))
        unstable = ~_is_positive_definite(*((w * np.exp(a * e[:, None])).sum(axis=1) for e in points))
        np.minimum.at(refuted, owner[unstable], middle[unstable])
        open_cells = np.flatnonzero(~proved & (row < refuted[owner]))
        if not len(open_cells) or len(open_cells) > _MOST_CELLS:
            break
        height, width = height / 2, width / 2
        owner = np.tile(owner[open_cells], 4)
        row = (row[open_cells] + np.array([[0], [0], [1], [1]]) * height[owner[: len(open_cells)]]).ravel()
        share = (share[open_cells] + np.array([[0], [1], [0], [1]]) * width).ravel()
        open_cells = np.arange(len(owner))
    limit = log_stretch.copy()
    np.minimum.at(limit, owner[open_cells], row[open_cells])
    return limit


def _lower_bound(weight: Array, alpha: Array, start: Array, end: Array) -> Array:
    """Return a lower bound of f(e), the sum of weight exp(alpha e) over the terms, on each of n intervals, (n,).

    The intervals extend from ``start`` to ``end``, (n,).
    """
    # A term with a positive weight is convex and lies above its tangent. A term with a negative weight is concave and
    # lies above its chord. f therefore lies above the sum of these straight lines, which is smallest at one end of the
    # interval. A second bound is the sum of the smallest values of the terms.
    start, end = start[..., None], end[..., None]
    first, last = weight * np.exp(alpha * start), weight * np.exp(alpha * end)
    tangent, slope = weight * np.exp(0.5 * alpha * (start + end)), 0.5 * alpha * (end - start)
    convex = weight > 0
    line = np.minimum(
        np.where(convex, tangent * (1 - slope), first).sum(axis=-1),
        np.where(convex, tangent * (1 + slope), last).sum(axis=-1),
    )
    return np.asarray(np.maximum(line, np.minimum(first, last).sum(axis=-1)))


def _is_positive_definite(a: Array, b: Array, c: Array) -> NDArray[np.bool_]:
    """Return whether a d_1^2 + b d_2^2 + c d_3^2 > 0 for all d other than zero with d_1 + d_2 + d_3 = 0."""
    return np.asarray((a + b + c > 0) & (a * b + b * c + c * a > 0))
