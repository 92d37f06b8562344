"""The edges of a simulated beam as a camera sees them, as curves of quadratic segments in the beam frame.

In a planar model each edge is one line. In a solid model the camera sees the outermost points of the left and the right
face, which are curved (Timoshenko and Goodier, Theory of Elasticity, section 102).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.beam.bricks import Bricks
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.path import Shapes
from eimi_fitting.beam.solid_model import SolidModel
from eimi_fitting.beam.view import View

Array = NDArray[np.float64]
Model = BeamModel | SolidModel | SolidBeside


def edge_curves(model: BeamModel, shapes: Shapes) -> Array:
    """Return the left and the right edge of a planar beam model, as curves of quadratic segments."""
    # (P, K, 2, S, 3, 2) in mm: P candidate laws, K load states, the left edge (y < 0 at rest) first, S segments from
    # clamp to tip, three points (x, y) each.
    place = model.mesh.nodes + shapes.displacement
    return _segments(np.stack([place[:, :, model.mesh.row(0)], place[:, :, model.mesh.row(-1)]], axis=2))


def outline(model: Model, shapes: Shapes, view: View | None = None) -> Array:
    """Return the left and the right outline of a beam model as a camera sees them.

    Raises
    ------
    ValueError
        The specimen reaches the pupil of the lens.
    """
    # The result has the shape of that of `edge_curves`. ``view``: None for a telecentric lens.
    if isinstance(model, BeamModel):
        if view is None:
            return edge_curves(model, shapes)
        place = _flat_faces(model, shapes)
    else:
        place = _bowed_faces(model.mesh, shapes)
    if view is None:
        projected = place[..., :2]
    else:
        if not np.abs(place[..., 2]).max() < view.stand_off_mm:
            raise ValueError(
                f"stand_off_mm = {view.stand_off_mm:g} lies inside the specimen: give the distance from the beam's "
                "mid-depth to the pupil of the lens"
            )
        behind = place[..., :0:-1, :] * [1.0, 1.0, -1.0]
        projected = view.seen(np.concatenate([behind, place], axis=-2))
    if view is None:
        curves = projected[..., -1, :]
        for _ in range(2):
            curves = _farthest(projected, _outward(curves))
        return _segments(curves)
    middle = projected[..., projected.shape[-2] // 2, :]
    normal = _outward(middle)
    return _segments(_farthest(_at_normals(projected, middle, normal), normal))


def _bowed_faces(mesh: Bricks, shapes: Shapes) -> Array:
    """Return the nodes on the left and the right face of a solid model in mm."""
    # (P, K, 2, n, m, 3): at each of n stations along the beam, m nodes lead from mid-depth to the surface with z > 0.
    numbers = mesh.numbers
    sides = np.stack([numbers[:, 0], numbers[:, -1]])
    return np.asarray(mesh.nodes[sides] + shapes.displacement[:, :, sides])


def _flat_faces(model: BeamModel, shapes: Shapes) -> Array:
    """Return points on the left and the right face of a planar model in mm."""
    # (P, K, 2, n, 3, 3): at each of n stations along the beam, three points lead from mid-depth to the surface with z >
    # 0.
    place = model.mesh.nodes + shapes.displacement
    sides = np.stack([place[:, :, model.mesh.row(0)], place[:, :, model.mesh.row(-1)]], axis=2)
    along = model.grid.straight_mm[model.mesh.row(0), 0]
    depth = 0.5 * model.grid.strip.depth_mm(along)[:, None] * np.linspace(0, 1, 3)
    lines = np.broadcast_to(sides[..., None, :], (*sides.shape[:-1], 3, 2))
    return np.concatenate([lines, np.broadcast_to(depth[..., None], (*lines.shape[:-1], 1))], axis=-1)


def _segments(sides: Array) -> Array:
    """Divide curves of points into quadratic segments."""
    # (..., 2 S + 1, 2) gives (..., S, 3, 2).
    return np.stack([sides[..., 0:-1:2, :], sides[..., 1::2, :], sides[..., 2::2, :]], axis=-2)


def _outward(curves: Array) -> Array:
    """Return the outward unit normals of the left and the right edge."""
    # (..., 2, n, 2) for n points of each edge.
    step = np.diff(curves, axis=-2)
    length = np.linalg.norm(step, axis=-1, keepdims=True)
    direction = step / length
    ahead = length[..., 1:, :] / (length[..., 1:, :] + length[..., :-1, :])
    inner = ahead * direction[..., :-1, :] + (1 - ahead) * direction[..., 1:, :]
    tangent = np.concatenate([direction[..., :1, :], inner, direction[..., -1:, :]], axis=-2)
    normal = np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)
    return np.asarray(normal * np.array([-1.0, 1.0])[:, None, None])


def _at_normals(lines: Array, middle: Array, normal: Array) -> Array:
    """Return the intersections of curves with straight lines, by an iteration."""
    # ``lines`` (..., n, m, 2): m curves of n points. ``middle``, ``normal`` (..., n, 2): a point and the unit direction
    # of each of n normals. The result is (..., n, m, 2).
    n = lines.shape[-3]
    tangent = np.stack([normal[..., 1], -normal[..., 0]], axis=-1)
    across = [np.einsum("...ndi,...ni->...nd", lines - middle[..., None, :], way) for way in (tangent, normal)]
    # The place on each line where the normal of a station crosses it, as a number of stations from the clamp.
    x, y = lines[..., 0], lines[..., 1]
    at = np.broadcast_to(np.arange(n, dtype=float)[:, None], x.shape)
    at = at - across[0] / np.einsum("...ndi,...ni->...nd", np.gradient(lines, axis=-3), tangent)
    for _ in range(2):
        first = 2 * np.clip(at // 2, 0, (n - 3) // 2).astype(int)
        xi = at - first - 1.0
        corner_x, corner_y = ([np.take_along_axis(of, first + k, axis=-2) for k in range(3)] for of in (x, y))
        gap, slope = [], []
        for (one, two, three), origin in zip((corner_x, corner_y), (middle[..., 0], middle[..., 1]), strict=True):
            bend, mean = one - 2 * two + three, 0.5 * (three - one)
            gap.append(two + xi * (mean + 0.5 * xi * bend) - origin[..., None])
            slope.append(mean + xi * bend)
        along, ahead = (of[0] * tangent[..., None, 0] + of[1] * tangent[..., None, 1] for of in (gap, slope))
        at = at - along / ahead
    height = gap[0] * normal[..., None, 0] + gap[1] * normal[..., None, 1]
    height -= along / ahead * (slope[0] * normal[..., None, 0] + slope[1] * normal[..., None, 1])
    return np.asarray(middle[..., None, :] + height[..., None] * normal[..., None, :])


def _farthest(lines: Array, normal: Array) -> Array:
    """Return the outermost point of each curve on a face of the beam."""
    # ``lines`` (..., n, 2 D + 1, 2): n curves of D quadratic segments through the depth of the beam, projected to x and
    # y. ``normal`` (..., n, 2): outward unit vectors. The result is (..., n, 2).
    first, middle, last = lines[..., 0:-1:2, :], lines[..., 1::2, :], lines[..., 2::2, :]  # (..., n, D, 2)
    slope, bend = 0.5 * (last - first), first - 2 * middle + last
    along, curved = (np.einsum("...ndi,...ni->...nd", v, normal) for v in (slope, bend))
    top = np.clip(-along / np.where(curved < 0, curved, -1.0), -1.0, 1.0)
    top = np.where(curved < 0, top, np.where(along > 0, 1.0, -1.0))[..., None]
    places = middle + top * (slope + 0.5 * top * bend)
    best = np.argmax(np.einsum("...ndi,...ni->...nd", places, normal), axis=-1)
    return np.take_along_axis(places, best[..., None, None], axis=-2)[..., 0, :]


def points_on(curves: Array, per_segment: int) -> Array:
    """Convert curves of quadratic segments to polylines."""
    # (..., S, 3, 2) gives (..., S * per_segment + 1, 2).
    xi = np.linspace(-1, 1, per_segment + 1)[:-1]
    shape = np.stack([0.5 * xi * (xi - 1), 1 - xi * xi, 0.5 * xi * (xi + 1)])
    inner = np.einsum("...sad,ax->...sxd", curves, shape)
    inner = inner.reshape(*curves.shape[:-3], -1, 2)
    return np.concatenate([inner, curves[..., -1, 2:3, :]], axis=-2)
