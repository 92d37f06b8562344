"""The planar mesh of a specimen: lines along and across the beam, with quadratic elements between them.

The lines lie in a straight reference beam, which `beam.strip` maps to the specimen at rest. The mesh has no elements in
the rigid magnet.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.mesh import Indices, Mesh, graded, grid_mesh, shape_functions
from eimi_fitting.beam.pressure import FollowerPressure
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.beam.strip import Strip

Array = NDArray[np.float64]

# With this grading the tip of a slender beam on 13 x 1 elements has a seventh of the error of equal elements.
_FINER_AT_CLAMP, _FINER_AT_MAGNET = 10.0, 5.0
_FINER_AT_CORNER = 3.0  # across, toward the corners of a narrower magnet
# Share of the width of the beam. A layer of silicone on a magnet moves rigidly with the magnet if it is thinner than
# this share. For the layers on the sides, this changes the displacement of the tip by 0.05 %. With very thin elements
# instead, Newton's method would take ten times as many steps.
THINNEST = 0.02
_SAME_MM = 1e-3  # points that are nearer are the same


def _across_magnet(width: float, magnet_width: float, across: int) -> tuple[Array, int]:
    """Return y (mm) of the mesh lines across a beam with a narrower magnet, and the number of elements beside it."""
    # ``across``: the number of elements across a beam without a magnet.
    layer, size = 0.5 * (width - magnet_width), width / across
    least = (across + 1) // 2
    beside, inner = max(least, round(1.5 * layer / size)), max(least, round(magnet_width / size))
    side = 0.5 * magnet_width + graded(layer, beside, 0.5 * layer, _FINER_AT_CORNER, 0.0)
    middle = graded(magnet_width, inner, 0.5 * layer, _FINER_AT_CORNER, _FINER_AT_CORNER) - 0.5 * magnet_width
    return np.concatenate([-side[::-1], middle[1:-1], side]), beside


def _count(along: int, relative_length: float) -> int:
    """Return the number of elements along a section of the beam."""
    # ``relative_length``: its length divided by that of the flexible part, which has ``along`` elements.
    return max(2, min(round(along * relative_length), 2 * along))


class Grid:
    """The planar mesh of a specimen, generated for a straight beam and then mapped to the unloaded shape."""

    # ``strip``: the map from the reference beam to the specimen at rest.
    # ``straight_mm`` (N, 2): positions (x, y) of the N nodes in the reference beam.
    # ``mesh``: the elements of silicone, and the nodes of silicone and magnet.
    # ``face_mm``: middle (x, y) at rest of the magnet's inner face, or of the tip without a magnet.
    # ``turn_rad``: angle of the magnet at rest from +x toward +y.
    # ``block_mm``: length, width and depth of the rigid block (magnet and rigid silicone); zero without a magnet.
    # ``magnet_nodes``: nodes on and in the rigid block, or None.
    # ``inside`` (cells along, cells across): whether each cell between the mesh lines lies in the rigid block.
    # ``per_specimen``: load per mm of depth divided by the load on the specimen, in 1/mm.

    def __init__(self, specimen: Specimen, along: int, across: int, divided: bool = False) -> None:
        # ``along``: number of elements along the flexible part. ``across``: number of elements across the width.
        # ``divided``: whether a magnet that is as wide as the beam is divided into elements.
        self.strip = Strip(specimen)
        self.specimen = specimen
        specimen = self._straight = self.strip.straight
        near, width, magnet = specimen.flexible_length_mm, specimen.width_mm, specimen.magnet
        kinks = self.strip.kinks_mm
        x = graded(near, along, 0.5 * width, _FINER_AT_CLAMP, _FINER_AT_MAGNET if magnet else 0.0, kinks)
        flexible = len(x) - 1
        y = np.linspace(-0.5 * width, 0.5 * width, across + 1)
        self.block_mm = (0.0, 0.0, 0.0)
        self.per_specimen = 1 / specimen.depth_mm
        inside = np.zeros((flexible, across), bool)
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
            inside[flexible : flexible + len(over), beside : len(y) - 1 - beside] = True
        self.x_mm, self.y_mm, self.inside = x, y, inside
        mesh = grid_mesh(x, y)
        self.straight_mm = mesh.nodes
        mesh = replace(
            mesh, nodes=self.strip.at_rest(mesh.nodes), thickness=self.strip.thickness(self.straight_mm[:, 0])
        )
        face = self.strip.at_rest(np.array([[near, 0.0]]))[0]
        self.face_mm = (float(face[0]), float(face[1]))
        self.turn_rad = float(self.strip.angle_rad(np.array([near]))[0])
        self._all = mesh.elements
        block = mesh.elements[inside.ravel()]
        self.magnet_nodes: Indices | None = np.unique(block).astype(np.intp) if magnet else None
        self.mesh: Mesh = replace(mesh, elements=mesh.elements[~inside.ravel()])

    def straightened(self, points_mm: Array) -> Array:
        """Map points of the specimen at rest to the straight reference beam."""
        return self.strip.straightened(np.atleast_2d(np.asarray(points_mm, float)))

    def on_magnet(self, points_mm: Array) -> NDArray[np.bool_]:
        """Return whether each point moves rigidly with the magnet."""
        # ``points_mm`` (n, 2): points (x, y) of the straight reference beam.
        x, y = np.atleast_2d(np.asarray(points_mm, float)).T
        near, (length, width, _) = self._straight.flexible_length_mm, self.block_mm
        if self.magnet_nodes is None:
            return np.zeros(len(x), bool)
        far = near + length if near + length < self._straight.length_mm - 1e-9 else np.inf
        half = 0.5 * width if width < self._straight.width_mm else np.inf
        return np.asarray((x > near + 1e-9) & (x <= far) & (np.abs(y) <= half))

    def place(self, points_mm: Array) -> tuple[Indices, Array]:
        """Find the element around each point; return its nodes and the values of its shape functions.

        Raises
        ------
        ValueError
            A point is more than 1 µm outside the specimen.
        """
        # ``points_mm`` (n, 2): points (x, y) of the straight reference beam. The results are (n, 9).
        points = np.atleast_2d(np.asarray(points_mm, float))
        length, width = self._straight.length_mm, self._straight.width_mm
        outside = (np.abs(points[:, 0] - 0.5 * length) > 0.5 * length + _SAME_MM) | (
            np.abs(points[:, 1]) > 0.5 * width + _SAME_MM
        )
        if outside.any():
            x, y = points[np.argmax(outside)]
            raise ValueError(
                f"point ({x:g}, {y:g}) mm is not on the specimen, which covers x from 0 to {length:g} mm and y from "
                f"{-width / 2:g} to {width / 2:g} mm"
            )
        m, n = len(self.x_mm) - 1, len(self.y_mm) - 1
        s = np.interp(points[:, 0], self.x_mm, np.arange(m + 1))
        t = np.interp(points[:, 1], self.y_mm, np.arange(n + 1))
        i, j = np.clip(s.astype(int), 0, m - 1), np.clip(t.astype(int), 0, n - 1)
        values, _ = shape_functions(2 * (s - i) - 1, 2 * (t - j) - 1)
        return self._all[i * n + j], values

    def through_depth(self, point_mm: Array) -> tuple[Indices, Array]:
        """Return the nodes that share a force at a point, and their fractions of the force."""
        # ``point_mm``: the point (x, y) in the straight reference beam. The results are (1, 9).
        return self.place(point_mm)

    def pressure_face(self) -> FollowerPressure | None:
        """Return the part of the left or right side on which a pressure acts; None without a pressure."""
        face = self.specimen.pressure_face
        if face is None:
            return None
        # With the body to the left: along the left face (y < 0) toward the tip, along the right one toward the clamp.
        nodes = self.mesh.row(0) if face.side == "left" else self.mesh.row(-1)[::-1]
        ends = self.straight_mm[nodes[::2], 0]
        last = self.specimen.length_mm if face.to_mm is None else face.to_mm
        middle, half = 0.5 * (ends[1:] + ends[:-1]), 0.5 * (ends[1:] - ends[:-1])
        spans = np.clip((np.array([[face.from_mm], [last]]) - middle) / half, -1.0, 1.0)
        return FollowerPressure(self.mesh, nodes, np.sort(spans, axis=0).T)
