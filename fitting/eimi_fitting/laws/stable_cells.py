"""Prove that a law such as Ogden's is stable (Drucker) in whole ranges of deformations, called cells.

The Hessian of the strain energy by the logarithmic principal stretches e_i is diagonal with the entries f(e_i). In a
cell, each e_i lies in an interval. All deformations of the cell are stable if Drucker's criterion is fulfilled with the
lower bounds of f on the three intervals.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ROWS, _COLUMNS = 8, 12  # number of cells before the first division
_SPLITS = 16  # largest number of divisions of a cell; the logarithm of the limit is then accurate to 4e-6
_MOST_CELLS = 100_000


def proved_stable(weight: Array, alpha: Array, log_stretch: Array) -> Array:
    """Return the logarithm of the largest stretch up to which a law is proved stable (Drucker).

    Parameters
    ----------
    weight, alpha
        (P, 3) constants of f(e), the sum of weight exp(alpha e) over three terms. The Hessian of the strain energy by
        the logarithmic principal stretches e_i is diagonal with the entries f(e_i).
    log_stretch
        (P,) logarithm of the largest stretch to examine.

    Returns
    -------
    Array
        (P,) logarithms of the stretches, at most ``log_stretch``.
    """
    # The logarithmic stretches are l, l s and -l (1 + s), with s = -1/2 in uniaxial, 0 in planar and 1 in equibiaxial
    # tension. A cell is a rectangle of the plane (l, s). A cell without a proof is divided into four.
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
    # A lower bound of f(e), the sum of weight exp(alpha e) over the terms, in each of n intervals of e: (n,).
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
