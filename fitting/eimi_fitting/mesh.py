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


def beam_mesh(
    length_mm: float,
    width_mm: float,
    along: int,
    across: int,
    finer_at_clamp: float = 0.0,
    finer_at_end: float = 0.0,
) -> Mesh:
    """A rectangle 0..length by -width/2..width/2.

    At the clamp the elements are ``1 + finer_at_clamp`` times shorter than far from it, at the other end
    ``1 + finer_at_end`` times; the grading fades over half a width, as the disturbance of a clamped end does.
    """
    x = np.linspace(0.0, length_mm, 2001)
    fade = 0.5 * width_mm
    density = 1 + finer_at_clamp * np.exp(-x / fade) + finer_at_end * np.exp((x - length_mm) / fade)
    count = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
    ends = np.interp(np.linspace(0, count[-1], along + 1), count, x)
    return mapped_mesh(
        along, across, lambda s, t: (np.interp(s, np.linspace(0, 1, along + 1), ends), (t - 0.5) * width_mm)
    )


def shape_functions(xi: Array, eta: Array) -> tuple[Array, Array]:
    """Nine-node Lagrange functions at n points: values (n, 9) and local derivatives (n, 9, 2)."""

    def line(s: Array) -> tuple[Array, Array]:
        value = np.stack([0.5 * s * (s - 1), 1 - s * s, 0.5 * s * (s + 1)], axis=-1)
        slope = np.stack([s - 0.5, -2 * s, s + 0.5], axis=-1)
        return value, slope

    (a, da), (b, db) = line(np.asarray(xi, float)), line(np.asarray(eta, float))
    n = a.shape[0]
    value = (a[:, :, None] * b[:, None, :]).reshape(n, 9)
    slope = np.stack([(da[:, :, None] * b[:, None, :]), (a[:, :, None] * db[:, None, :])], axis=-1)
    return value, slope.reshape(n, 9, 2)
