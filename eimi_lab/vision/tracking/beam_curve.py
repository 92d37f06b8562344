"""The centre line of a beam of fixed length, whose direction is a polynomial in the arc length."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

Array = NDArray[np.float64]

DEGREE = 6
_NODES = 129
_STIFF = 1e-4  # weight of the regularisation per point; parts of the beam without points keep their direction
_USUAL_STIFF = 2e-4  # weight per point with which the direction is pulled toward that of the curve `usual`
_USUAL_ROOT = 0.05  # weight per point with which the first point is pulled toward that of the curve `usual`

_OF_NODES = chebyshev.chebvander((2.0 * np.arange(_NODES - 1) + 1.0) / (_NODES - 1.0) - 1.0, DEGREE)
"""The Chebyshev polynomials midway between neighbouring nodes of the arc length, shape (nodes - 1, DEGREE + 1)."""


@dataclass(frozen=True)
class BeamCurve:
    """The centre line of a beam in the picture.

    Parameters
    ----------
    root_px : ndarray, shape (2,)
        First point, at the clamp.
    coefficients : ndarray, shape (DEGREE + 1,)
        Chebyshev coefficients of the direction (radians, clockwise from +x) as a function of arc length.
    length_px : float
        Length of the line.

    Examples
    --------
    >>> straight = BeamCurve(np.zeros(2), np.zeros(DEGREE + 1), 10.0)
    >>> places, normals = straight.at(np.array([0.0, 5.0, 10.0]))
    >>> places.round(6).tolist(), normals[0].tolist()
    ([[0.0, 0.0], [5.0, 0.0], [10.0, 0.0]], [-0.0, 1.0])
    """

    root_px: Array
    coefficients: Array
    length_px: float

    def at(self, along_px: Array) -> tuple[Array, Array]:
        """Return the points (px) and unit normals of the line at given arc lengths (px)."""
        nodes, places = self._integrated
        direction = self._direction(along_px)
        x, y = (np.interp(along_px, nodes, places[:, axis]) for axis in range(2))
        return np.column_stack([x, y]), np.column_stack([-np.sin(direction), np.cos(direction)])

    def moved(self, along_px: Array, offset_px: Array, weight: Array, usual: BeamCurve | None = None) -> BeamCurve:
        """Return the curve after one least-squares step toward points beside the curve.

        Parameters
        ----------
        along_px : ndarray, shape (p,)
            Arc length of each point.
        offset_px : ndarray, shape (p,)
            Distance of each point from the curve, along its normal.
        weight : ndarray, shape (p,)
            Weight of each point.
        usual : BeamCurve, optional
            Curve toward which the ends are pulled; by default the ends keep their direction.
        """
        nodes, _ = self._integrated
        direction = _OF_NODES @ self.coefficients
        velocity = np.stack([-np.sin(direction), np.cos(direction)], axis=1)[:, :, None] * _OF_NODES[:, None, :]
        velocity *= nodes[1]
        moved = np.concatenate([np.zeros((1, 2, DEGREE + 1)), np.cumsum(velocity, axis=0)])
        at = np.clip(np.rint(along_px / nodes[1]).astype(int), 0, len(nodes) - 1)
        _, normals = self.at(along_px)
        root = self._direction(np.zeros(1))
        across = np.concatenate([-np.sin(root), np.cos(root)])
        jacobian = np.column_stack([normals @ across, np.einsum("pa,pak->pk", normals, moved[at])])
        weighted = jacobian * weight[:, None]
        scale = np.maximum(np.abs(jacobian).max(axis=0), 1e-9)
        total, degrees = max(weight.sum(), 1.0), np.arange(DEGREE + 1)
        if usual is None:
            stiff = _STIFF * total * scale**2 * np.concatenate([[1.0], degrees**2])
            wanted = np.zeros(len(stiff))
        else:
            stiff = total * scale**2 * np.concatenate([[_USUAL_ROOT], _USUAL_STIFF * degrees**3])
            wanted = np.append((usual.root_px - self.root_px) @ across, usual.coefficients - self.coefficients)
        change_of = np.linalg.solve(
            weighted.T @ jacobian + np.diag(stiff + 1e-12), weighted.T @ offset_px + stiff * wanted
        )
        return BeamCurve(self.root_px + change_of[0] * across, self.coefficients + change_of[1:], self.length_px)

    def extrapolated(self, before: BeamCurve, share: float) -> BeamCurve:
        """Return this curve plus `share` times its change since the curve `before`."""
        return BeamCurve(
            self.root_px, self.coefficients + share * (self.coefficients - before.coefficients), self.length_px
        )

    def _direction(self, along_px: Array) -> Array:
        return np.asarray(chebyshev.chebvander(2.0 * along_px / self.length_px - 1.0, DEGREE) @ self.coefficients)

    @cached_property
    def _integrated(self) -> tuple[Array, Array]:
        nodes = np.linspace(0.0, self.length_px, _NODES)
        direction = _OF_NODES @ self.coefficients
        steps = np.column_stack([np.cos(direction), np.sin(direction)]) * nodes[1]
        return nodes, self.root_px + np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def curve_through(points_px: Array, length_px: float) -> BeamCurve:
    """Return the centre line of a beam through ordered points.

    Parameters
    ----------
    points_px : ndarray, shape (n, 2)
        Points from the clamp outward; the first one is at the clamp.
    length_px : float
        Length of the beam; beyond the last point the line continues straight.
    """
    steps = np.diff(points_px, axis=0)
    lengths = np.hypot(*steps.T)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    middle, direction = 0.5 * (along[1:] + along[:-1]), np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    grid = np.linspace(0.0, length_px, 4 * DEGREE + 1)
    smooth = np.interp(grid, middle, direction)
    coefficients = np.asarray(chebyshev.chebfit(2.0 * grid / length_px - 1.0, smooth, DEGREE), dtype=np.float64)
    curve = BeamCurve(np.asarray(points_px[0], dtype=np.float64), coefficients, length_px)
    inside = along <= length_px
    for _ in range(3):
        places, normals = curve.at(along[inside])
        offset = ((points_px[inside] - places) * normals).sum(axis=1)
        curve = curve.moved(along[inside], offset, np.ones(int(inside.sum())))
    return curve
