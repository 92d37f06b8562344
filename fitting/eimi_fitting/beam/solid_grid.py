"""The solid mesh of half of a specimen (z > 0): the planar mesh, extruded through the depth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.bricks import Bricks, brick_mesh, shape_functions
from eimi_fitting.beam.grid import THINNEST, Grid
from eimi_fitting.beam.mesh import Indices, graded
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.beam.strip import Strip

Array = NDArray[np.float64]

_SAME_MM = 1e-3  # points that are nearer are the same
_FEWEST = 2  # elements over half the depth; with one the modulus is 0.2 % off
_DEEP = 3.0  # ratio of depth to width above which a part has one element more
_FINER_AT_EDGE = 3.0  # grading in depth toward the magnet's edge


def _depth_lines(specimen: Specimen, magnet_depth: float, more: int) -> Array:
    """Return the z coordinates of the mesh lines from mid-depth to the surface in mm."""
    # ``more``: number of elements in addition to the usual number.
    half, edge, width = 0.5 * specimen.depth_mm, 0.5 * magnet_depth, specimen.width_mm
    if not 0 < edge < half:
        return np.linspace(0, half, _FEWEST + more + 1)
    layer = half - edge
    # The part inside the depth of the magnet and the part outside each get ``more`` elements.
    behind, before = (_FEWEST + more + (part > _DEEP / 2 * width) for part in (edge, layer))
    fade = 0.5 * min(width, layer)
    inner = graded(edge, behind, fade, 0.0, _FINER_AT_EDGE)
    return np.concatenate([inner, edge + graded(layer, before, fade, _FINER_AT_EDGE, 0.0)[1:]])


class SolidGrid:
    """The solid mesh of half of a specimen (z > 0), mapped from the mesh of a straight beam."""

    # ``flat``: the planar mesh of the specimen.
    # ``strip``: the map from the reference beam to the specimen at rest.
    # ``straight_mm`` (N, 3): positions (x, y, z) of the N nodes in the reference beam.
    # ``z_mm``: the z coordinates of the mesh lines.
    # ``mesh``: the elements of silicone.
    # ``per_specimen``: the fraction of a load on the specimen that acts on the mesh, 1/2.
    # ``block_mm``, ``magnet_nodes``, ``face_mm``, ``turn_rad``: as in the planar mesh (`Grid`).

    per_specimen = 0.5

    def __init__(self, specimen: Specimen, along: int, across: int, more: int = 0) -> None:
        # ``along``, ``across``: numbers of elements along the flexible part and across the width. ``more``: number of
        # elements across the depth in addition to the usual number.
        self.specimen = specimen
        strip = self.strip = Strip(specimen)
        specimen = self._straight = strip.straight
        magnet, depth = specimen.magnet, specimen.depth_mm
        deep = magnet.depth_mm if magnet else 0.0
        shallower = magnet is not None and depth - deep > 2 * THINNEST * specimen.width_mm
        self.flat = Grid(self.specimen, along, across, divided=shallower)
        self.z_mm = _depth_lines(specimen, deep if shallower else depth, more)
        self.block_mm = (*self.flat.block_mm[:2], deep if shallower else self.flat.block_mm[2])
        middle = 0.5 * (self.z_mm[1:] + self.z_mm[:-1])
        inside = self.flat.inside[:, :, None] & (middle < 0.5 * self.block_mm[2])
        mesh = brick_mesh(self.flat.x_mm, self.flat.y_mm, self.z_mm)
        self.straight_mm = mesh.nodes
        if not strip.is_straight:
            flat, z_mm = strip.at_rest(mesh.nodes[:, :2]), strip.z_at_rest_mm(mesh.nodes[:, 0], mesh.nodes[:, 2])
            mesh = replace(mesh, nodes=np.column_stack([flat, z_mm]))
        self.face_mm, self.turn_rad = self.flat.face_mm, self.flat.turn_rad
        self._all = mesh.elements
        block = np.unique(mesh.elements[inside.ravel()]).astype(np.intp)
        self.magnet_nodes: Indices | None = block if magnet else None
        self.mesh: Bricks = replace(mesh, elements=mesh.elements[~inside.ravel()])

    def straightened(self, points_mm: Array) -> Array:
        """Map points of the unloaded specimen to the straight reference beam."""
        points = np.atleast_2d(np.asarray(points_mm, float))
        flat = self.flat.straightened(points[:, :2])
        if points.shape[1] == 2:
            return flat
        return np.column_stack([flat, self.strip.straight_z_mm(flat[:, 0], points[:, 2])])

    def on_magnet(self, points_mm: Array) -> NDArray[np.bool_]:
        """Return whether each point moves rigidly with the magnet."""
        # ``points_mm`` (n, 2 or 3): points (x, y) or (x, y, z) of the straight reference beam.
        points = np.atleast_2d(np.asarray(points_mm, float))
        on = self.flat.on_magnet(points[:, :2])
        if points.shape[1] == 3 and self.block_mm[2] < self._straight.depth_mm:
            on &= np.abs(points[:, 2]) <= 0.5 * self.block_mm[2]
        return on

    def place(self, points_mm: Array) -> tuple[Indices, Array]:
        """Find the element around each point; return its nodes and the values of its shape functions.

        Raises
        ------
        ValueError
            A point is more than 1 µm outside the specimen.
        """
        # ``points_mm`` (n, 3): points (x, y, z) of the straight reference beam. The results are (n, 27).
        points = np.atleast_2d(np.asarray(points_mm, float))
        depth = np.abs(points[:, 2])
        if np.any(depth > self.z_mm[-1] + _SAME_MM):
            raise ValueError(
                f"a point at z = {points[np.argmax(depth), 2]:g} mm is not on the specimen, which covers z from "
                f"{-self.z_mm[-1]:g} to {self.z_mm[-1]:g} mm"
            )
        self.flat.place(points[:, :2])
        lines = (self.flat.x_mm, self.flat.y_mm, self.z_mm)
        cells, local = [], []
        for line, value in zip(lines, (points[:, 0], points[:, 1], depth), strict=True):
            s = np.interp(value, line, np.arange(len(line)))
            cells.append(np.clip(s.astype(int), 0, len(line) - 2))
            local.append(2 * (s - cells[-1]) - 1)
        n, k = len(lines[1]) - 1, len(lines[2]) - 1
        return self._all[(cells[0] * n + cells[1]) * k + cells[2]], shape_functions(*local)[0]

    def through_depth(self, point_mm: Array) -> tuple[Indices, Array]:
        """Distribute a point force through the depth; return the nodes and the fraction of the force on each."""
        # The force is spread over m points through the depth: (m, 27) each. ``point_mm``: the point (x, y) in the
        # straight reference beam.
        ends, half = self.z_mm, np.diff(self.z_mm) / 2
        gauss, weight = np.polynomial.legendre.leggauss(2)
        z = (ends[:-1, None] + half[:, None] * (1 + gauss)).ravel()
        nodes, values = self.place(np.column_stack([np.tile(point_mm, (len(z), 1)), z]))
        return nodes, values * ((half[:, None] * weight).ravel() / ends[-1])[:, None]
