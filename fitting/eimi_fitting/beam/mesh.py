"""Quadrilaterals with nine nodes: a structured beam, and any other patch given by its mapping."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True)
class Mesh:
    """nodes: (N, 2) mm; elements: (E, 9) node indices, local node 3 i + j at column i along, row j across.

    Nodes are numbered across first, so that the stiffness matrix has the smallest band. ``columns`` is the number
    of node columns, ``rows`` the number of nodes in each.
    """

    nodes: Array
    elements: Indices
    columns: int
    rows: int

    def column(self, i: int) -> Indices:
        """Nodes of column i (negative counts from the far end), in order across."""
        return np.arange(self.rows, dtype=np.intp) + (i % self.columns) * self.rows

    def row(self, j: int) -> Indices:
        """Nodes of row j (negative counts from the last), in order along."""
        return np.arange(self.columns, dtype=np.intp) * self.rows + (j % self.rows)


def mapped_mesh(along: int, across: int, mapping: Callable[[Array, Array], tuple[Array, Array]]) -> Mesh:
    """along x across elements on the unit square, their nodes put in place by ``mapping(s, t) -> (x, y)``.

    s runs along (0 to 1), t across (0 to 1). Raises ValueError for fewer than one element either way.
    """
    if along < 1 or across < 1:
        raise ValueError(f"a mesh needs at least 1 x 1 elements, got {along} x {across}")
    columns, rows = 2 * along + 1, 2 * across + 1
    s, t = np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, rows), indexing="ij")
    x, y = mapping(s.ravel(), t.ravel())
    i, j = np.meshgrid(np.arange(along), np.arange(across), indexing="ij")
    corner = (2 * i.ravel()) * rows + 2 * j.ravel()
    local = (np.arange(3)[:, None] * rows + np.arange(3)).ravel()
    return Mesh(np.column_stack([x, y]), (corner[:, None] + local).astype(np.intp), columns, rows)


def graded(length_mm: float, count: int, fade_mm: float, finer_at_start: float, finer_at_end: float) -> Array:
    """(count + 1,) ends of elements on 0..length.

    At the start they are ``1 + finer_at_start`` times shorter than far from it, at the end ``1 + finer_at_end`` times;
    the grading fades over ``fade_mm``.
    """
    x = np.linspace(0.0, length_mm, 2001)
    density = 1 + finer_at_start * np.exp(-x / fade_mm) + finer_at_end * np.exp((x - length_mm) / fade_mm)
    place = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
    return np.interp(np.linspace(0, place[-1], count + 1), place, x)


def grid_mesh(x_mm: Array, y_mm: Array) -> Mesh:
    """The rectangles between the lines x_mm (m + 1,) along and y_mm (n + 1,) across, both rising."""
    m, n = len(x_mm) - 1, len(y_mm) - 1
    return mapped_mesh(
        m, n, lambda s, t: (np.interp(s * m, np.arange(m + 1), x_mm), np.interp(t * n, np.arange(n + 1), y_mm))
    )


def quadratic_line(s: Array) -> tuple[Array, Array]:
    """Three-node Lagrange functions at n places on -1..1: values (n, 3) and derivatives (n, 3)."""
    s = np.asarray(s, float)
    return (
        np.stack([0.5 * s * (s - 1), 1 - s * s, 0.5 * s * (s + 1)], axis=-1),
        np.stack([s - 0.5, -2 * s, s + 0.5], axis=-1),
    )


def shape_functions(xi: Array, eta: Array) -> tuple[Array, Array]:
    """Nine-node Lagrange functions at n points: values (n, 9) and local derivatives (n, 9, 2)."""
    (a, da), (b, db) = quadratic_line(xi), quadratic_line(eta)
    n = a.shape[0]
    value = (a[:, :, None] * b[:, None, :]).reshape(n, 9)
    slope = np.stack([(da[:, :, None] * b[:, None, :]), (a[:, :, None] * db[:, None, :])], axis=-1)
    return value, slope.reshape(n, 9, 2)
