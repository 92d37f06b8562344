"""Structured meshes of quadrilaterals with nine nodes, on a rectangle or on a mapped rectangle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

_FINER_AT_STEP = 5.0


@dataclass(frozen=True)
class Mesh:
    """A structured mesh of quadrilaterals."""

    # E elements and N nodes.

    # (N, 2): positions (x, y) of the nodes in mm.
    nodes: Array
    # (E, 9): indices of the nodes of each element, in the order along, across; the last index changes fastest.
    elements: Indices
    # `columns`, `rows`: number of columns of nodes (each across the beam), and number of rows (each along the beam).
    columns: int
    rows: int
    # (N,): depth of the beam at the nodes divided by a reference depth; None if the depth is constant.
    thickness: Array | None = None

    def column(self, i: int) -> Indices:
        """Return the indices of the nodes in a column, ordered across the beam."""
        return np.arange(self.rows, dtype=np.intp) + (i % self.columns) * self.rows

    def row(self, j: int) -> Indices:
        """Return the indices of the nodes in a row, ordered along the beam."""
        return np.arange(self.columns, dtype=np.intp) * self.rows + (j % self.rows)


def mapped_mesh(along: int, across: int, mapping: Callable[[Array, Array], tuple[Array, Array]]) -> Mesh:
    """Divide the unit square into elements, and move the nodes by ``mapping(s, t) -> (x, y)``.

    Raises
    ------
    ValueError
        The number of elements in one direction is less than 1.
    """
    if along < 1 or across < 1:
        raise ValueError(f"a mesh needs at least one element along and one across, but {along} x {across} are given")
    columns, rows = 2 * along + 1, 2 * across + 1
    s, t = np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, rows), indexing="ij")
    x, y = mapping(s.ravel(), t.ravel())
    i, j = np.meshgrid(np.arange(along), np.arange(across), indexing="ij")
    corner = (2 * i.ravel()) * rows + 2 * j.ravel()
    local = (np.arange(3)[:, None] * rows + np.arange(3)).ravel()
    return Mesh(np.column_stack([x, y]), (corner[:, None] + local).astype(np.intp), columns, rows)


def graded(
    length_mm: float,
    count: int,
    fade_mm: float,
    finer_at_start: float,
    finer_at_end: float,
    steps_mm: Array | tuple[()] = (),
) -> Array:
    """Divide a length into elements that are shorter at its ends; return their boundaries in mm."""
    # ``count``: number of elements. ``fade_mm``: length of the refinement. ``finer_at_start``, ``finer_at_end``:
    # relative increase of the number of elements per mm at the ends. ``steps_mm``: coordinates that must be boundaries,
    # with more elements near them.
    x = np.linspace(0.0, length_mm, 2001)
    density = 1 + finer_at_start * np.exp(-x / fade_mm) + finer_at_end * np.exp((x - length_mm) / fade_mm)
    place = _cumulated(density)
    if not len(steps_mm):
        return np.interp(np.linspace(0, place[-1], count + 1), place, x)
    nearest = np.abs(x[:, None] - np.asarray(steps_mm)).min(axis=1)
    finer = _cumulated(density + _FINER_AT_STEP * np.exp(-nearest / fade_mm))
    ends = np.array([0.0, *np.interp(steps_mm, x, finer), finer[-1]])
    counts = np.maximum(np.round(count * np.diff(ends) / place[-1]).astype(int), 1)
    whole = np.arange(len(ends))
    inner = np.concatenate([first + np.arange(n) / n for first, n in enumerate(counts)])
    lines = np.interp(np.interp([*inner, whole[-1]], whole, ends), finer, x)
    lines[np.concatenate([[0], np.cumsum(counts)])] = [0.0, *steps_mm, length_mm]
    return np.asarray(lines)


def _cumulated(density: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])


def grid_mesh(x_mm: Array, y_mm: Array) -> Mesh:
    """Return a mesh of rectangles between lines at increasing coordinates."""
    m, n = len(x_mm) - 1, len(y_mm) - 1
    return mapped_mesh(
        m, n, lambda s, t: (np.interp(s * m, np.arange(m + 1), x_mm), np.interp(t * n, np.arange(n + 1), y_mm))
    )


def quadratic_line(s: Array) -> tuple[Array, Array]:
    """Evaluate three Lagrange functions and their derivatives at points from -1 to 1."""
    # (n, 3) each for n points.
    s = np.asarray(s, float)
    return (
        np.stack([0.5 * s * (s - 1), 1 - s * s, 0.5 * s * (s + 1)], axis=-1),
        np.stack([s - 0.5, -2 * s, s + 0.5], axis=-1),
    )


def shape_functions(xi: Array, eta: Array) -> tuple[Array, Array]:
    """Evaluate the nine Lagrange functions and their derivatives at points of the square from -1 to 1."""
    # (n, 9) and (n, 9, 2) for n points.
    (a, da), (b, db) = quadratic_line(xi), quadratic_line(eta)
    n = a.shape[0]
    value = (a[:, :, None] * b[:, None, :]).reshape(n, 9)
    slope = np.stack([(da[:, :, None] * b[:, None, :]), (a[:, :, None] * db[:, None, :])], axis=-1)
    return value, slope.reshape(n, 9, 2)
