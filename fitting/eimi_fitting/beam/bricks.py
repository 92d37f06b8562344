"""Structured meshes of hexahedra with 27 nodes, on a rectangular grid or mapped to another shape."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.mesh import Indices, quadratic_line

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Bricks:
    """A structured mesh of hexahedra."""

    # E elements and N nodes.

    # (N, 3): positions (x, y, z) of the nodes in mm.
    nodes: Array
    # (E, 27): indices of the nodes of each element, in the order along, across, in depth; the last index changes
    # fastest.
    elements: Indices
    # (nodes along, nodes across, nodes in depth): index of the node at each point of the grid.
    numbers: Indices


def brick_mesh(
    x_mm: Array,
    y_mm: Array,
    z_mm: Array,
    mapping: Callable[[Array, Array, Array], tuple[Array, Array, Array]] | None = None,
) -> Bricks:
    """Build a mesh of hexahedra between grid lines at increasing coordinates."""
    # ``mapping``: function of x, y and z in mm that moves the nodes; None: they stay on the grid.
    lines = [np.interp(np.arange(2 * len(v) - 1) / 2, np.arange(len(v)), v) for v in (x_mm, y_mm, z_mm)]
    along, across, deep = (len(line) for line in lines)
    numbers: Indices = np.arange(along * across * deep, dtype=np.intp)
    if across < deep:
        numbers = numbers.reshape(along, deep, across).swapaxes(1, 2)
    numbers = numbers.reshape(along, across, deep)
    places = [np.empty(numbers.size) for _ in lines]
    for place, values in zip(places, np.meshgrid(*lines, indexing="ij"), strict=True):
        place[numbers] = values
    corner = numbers[0:-1:2, 0:-1:2, 0:-1:2].ravel()
    elements = corner[:, None] + numbers[:3, :3, :3].ravel()
    return Bricks(np.column_stack(mapping(*places) if mapping else places), elements, numbers)


def shape_functions(xi: Array, eta: Array, zeta: Array) -> tuple[Array, Array]:
    """Evaluate the 27 Lagrange functions and their derivatives at points of the cube from -1 to 1."""
    # (n, 27) and (n, 27, 3) for n points.
    (a, da), (b, db), (c, dc) = (quadratic_line(s) for s in (xi, eta, zeta))

    def product(f: Array, g: Array, h: Array) -> Array:
        return np.einsum("ni,nj,nk->nijk", f, g, h).reshape(-1, 27)

    return product(a, b, c), np.stack([product(da, b, c), product(a, db, c), product(a, b, dc)], axis=-1)
