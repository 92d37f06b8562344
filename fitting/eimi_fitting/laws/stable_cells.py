"""How far an energy whose Hessian is diagonal is proved stable: bounds over cells of Drucker's triangle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ROWS, _COLUMNS = 8, 12  # cells of the triangle to begin with
_SPLITS = 16  # of a cell, at most: the limit is then found within 4e-6 in its logarithm
_MOST_CELLS = 100_000


def proved_stable(weight: Array, alpha: Array, most: Array) -> Array:
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
