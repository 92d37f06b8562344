"""How a specimen is divided: lines along and across, quadratic elements between them, and its magnet's block left out.

The magnet is rigid: its nodes are tied to one body, no element lies in it. Silicone beside a magnet narrower than the
beam, and beyond one that does not reach the tip, has elements of its own.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.mesh import Indices, Mesh, graded, grid_mesh, shape_functions
from eimi_fitting.beam.pressure import FollowerPressure
from eimi_fitting.beam.specimen import Specimen

Array = NDArray[np.float64]

# With these the tip of a slender beam on 13 x 1 elements is seven times nearer to the limit than with equal elements.
_FINER_AT_CLAMP, _FINER_AT_MAGNET = 10.0, 5.0
_FINER_AT_CORNER = 3.0  # across, toward the corners of a narrower magnet
# Of the width: thinner silicone on a magnet is carried rigidly. On the sides that moves the tip by 0.05 %, and its
# slivers of elements would take Newton's method ten times as many steps.
THINNEST = 0.02
_SAME_MM = 1e-3  # nearer than this is the same place


def _across_magnet(width: float, magnet_width: float, across: int) -> tuple[Array, int]:
    """Lines across silicone, magnet and silicone, and the number of elements on each side of the magnet."""
    layer, size = 0.5 * (width - magnet_width), width / across
    least = (across + 1) // 2
    beside, inner = max(least, round(1.5 * layer / size)), max(least, round(magnet_width / size))
    side = 0.5 * magnet_width + graded(layer, beside, 0.5 * layer, _FINER_AT_CORNER, 0.0)
    middle = graded(magnet_width, inner, 0.5 * layer, _FINER_AT_CORNER, _FINER_AT_CORNER) - 0.5 * magnet_width
    return np.concatenate([-side[::-1], middle[1:-1], side]), beside


def _count(along: int, times: float) -> int:
    """Elements along a part that is so many times as long as the flexible one, of its size but never without end."""
    return max(2, min(round(along * times), 2 * along))


class Grid:
    """mesh: the elements of silicone; its nodes cover the whole specimen, column by column from clamp to tip.

    along: elements of the flexible part, finer toward its two ends, which fades over half a width as the disturbance of
    a clamped end does; across: over the width, and half as many (rounded up) or more on each side of a magnet that
    is narrower, finer toward its corners. divided: lines across the block also where the magnet is as wide as the
    beam, for a solid that has silicone before and behind it. block_mm: length, width and depth of the rigid block,
    zero without a magnet; magnet_nodes: those on and in it, or None; inside: (along, across) which elements the block
    takes; per_specimen: what of a load on the whole specimen the model bears.
    """

    def __init__(self, specimen: Specimen, along: int, across: int, divided: bool = False) -> None:
        self.specimen = specimen
        near, width, magnet = specimen.flexible_length_mm, specimen.width_mm, specimen.magnet
        x = graded(near, along, 0.5 * width, _FINER_AT_CLAMP, _FINER_AT_MAGNET if magnet else 0.0)
        y = np.linspace(-0.5 * width, 0.5 * width, across + 1)
        self.block_mm = (0.0, 0.0, 0.0)
        self.per_specimen = 1 / specimen.depth_mm
        inside = np.zeros((along, across), bool)
        if magnet:
            narrower = width - magnet.width_mm > 2 * THINNEST * width
            covered = magnet.tip_offset_mm > THINNEST * width
            self.block_mm = (
                magnet.length_mm if covered else specimen.length_mm - near,
                magnet.width_mm if narrower else width,
                specimen.depth_mm,
            )
            far, beside = near + self.block_mm[0], 0
            over = np.array([self.block_mm[0]])
            if narrower:
                y, beside = _across_magnet(width, magnet.width_mm, across)
            if narrower or divided:
                count = _count(along, magnet.length_mm / near)
                finer = _FINER_AT_MAGNET if covered else 0.0
                over = graded(self.block_mm[0], count, 0.5 * width, _FINER_AT_MAGNET, finer)[1:]
            cap = np.zeros(0)
            if covered:
                count = _count(along, magnet.tip_offset_mm / near)
                cap = graded(magnet.tip_offset_mm, count, 0.5 * width, _FINER_AT_MAGNET, 0.0)[1:]
            x = np.concatenate([x, near + over, far + cap])
            inside = np.zeros((len(x) - 1, len(y) - 1), bool)
            inside[along : along + len(over), beside : len(y) - 1 - beside] = True
        self.x_mm, self.y_mm, self.inside = x, y, inside
        mesh = grid_mesh(x, y)
        self._all = mesh.elements
        block = mesh.elements[inside.ravel()]
        self.magnet_nodes: Indices | None = np.unique(block).astype(np.intp) if magnet else None
        self.mesh: Mesh = replace(mesh, elements=mesh.elements[~inside.ravel()])

    def on_magnet(self, points_mm: Array) -> NDArray[np.bool_]:
        """(n,): which points (n, 2), given at rest, the magnet carries.

        Also what is fixed to its free faces, outside the specimen: those that no silicone covers.
        """
        x, y = np.atleast_2d(np.asarray(points_mm, float)).T
        near, (length, width, _) = self.specimen.flexible_length_mm, self.block_mm
        if self.magnet_nodes is None:
            return np.zeros(len(x), bool)
        far = near + length if near + length < self.specimen.length_mm - 1e-9 else np.inf
        half = 0.5 * width if width < self.specimen.width_mm else np.inf
        return np.asarray((x > near + 1e-9) & (x <= far) & (np.abs(y) <= half))

    def place(self, points_mm: Array) -> tuple[Indices, Array]:
        """Nodes (n, 9) and weights (n, 9) that give the displacement of material points (n, 2) of the specimen.

        Raises ValueError for a point more than 1 µm outside it.
        """
        points = np.atleast_2d(np.asarray(points_mm, float))
        length, width = self.specimen.length_mm, self.specimen.width_mm
        outside = (np.abs(points[:, 0] - 0.5 * length) > 0.5 * length + _SAME_MM) | (
            np.abs(points[:, 1]) > 0.5 * width + _SAME_MM
        )
        if outside.any():
            x, y = points[np.argmax(outside)]
            raise ValueError(f"point ({x:g}, {y:g}) mm is not on the specimen (0..{length:g}, ±{width / 2:g} mm)")
        m, n = len(self.x_mm) - 1, len(self.y_mm) - 1
        s = np.interp(points[:, 0], self.x_mm, np.arange(m + 1))
        t = np.interp(points[:, 1], self.y_mm, np.arange(n + 1))
        i, j = np.clip(s.astype(int), 0, m - 1), np.clip(t.astype(int), 0, n - 1)
        values, _ = shape_functions(2 * (s - i) - 1, 2 * (t - j) - 1)
        return self._all[i * n + j], values

    def through_depth(self, point_mm: Array) -> tuple[Indices, Array]:
        """Nodes (1, 9) and weights (1, 9) that take a force at a point (2,). Raises ValueError as `place`."""
        return self.place(point_mm)

    def pressure_face(self) -> FollowerPressure | None:
        """The part of the left or right face that the specimen has under pressure."""
        face = self.specimen.pressure_face
        if face is None:
            return None
        # With the body to the left: along the left face (y < 0) toward the tip, along the right one toward the clamp.
        nodes = self.mesh.row(0) if face.side == "left" else self.mesh.row(-1)[::-1]
        ends = self.mesh.nodes[nodes[::2], 0]
        last = self.specimen.length_mm if face.to_mm is None else face.to_mm
        middle, half = 0.5 * (ends[1:] + ends[:-1]), 0.5 * (ends[1:] - ends[:-1])
        spans = np.clip((np.array([[face.from_mm], [last]]) - middle) / half, -1.0, 1.0)
        return FollowerPressure(self.mesh, nodes, np.sort(spans, axis=0).T)
