"""The edges that a camera sees of a simulated beam, as curves of quadratic segments in the beam frame.

A planar model has one line on each side. The face of a solid is seen as the envelope of its outermost points. The
section of a bent beam bows (anticlastic bending; Timoshenko and Goodier, Theory of Elasticity, section 102). The
outermost line therefore lies on the depth faces on the convex side, and at mid-depth on the concave side.
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
    """Return the two edges of a planar model.

    Returns
    -------
    ndarray, shape (P, K, 2, S, 3, 2)
        Left edge (y < 0 at rest) and right edge as S quadratic segments of three points in mm, from clamp to tip. Each
        side of an element is one segment, and so is the side of a magnet as wide as the beam, which stays straight.
    """
    place = model.mesh.nodes + shapes.displacement
    return _segments(np.stack([place[:, :, model.mesh.row(0)], place[:, :, model.mesh.row(-1)]], axis=2))


def outline(model: Model, shapes: Shapes, view: View | None = None) -> Array:
    """Return the left and the right outline of the beam as a camera sees them.

    The outline is the envelope of the lines on the face. At each station along the beam it passes through the point of
    the face, at any depth, that lies farthest out along the normal of the outline. The faces of a planar model are
    flat.

    Parameters
    ----------
    model : BeamModel, SolidModel or SolidBeside
    shapes : Shapes
    view : View or None
        The camera's lens; None for a telecentric lens.

    Returns
    -------
    ndarray, shape (P, K, 2, S, 3, 2)
        Quadratic segments as in `edge_curves`.

    Raises
    ------
    ValueError
        The specimen reaches the pupil of the lens.
    """
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
            raise ValueError(f"a stand-off of {view.stand_off_mm:g} mm is within the specimen")
        behind = place[..., :0:-1, :] * [1.0, 1.0, -1.0]
        projected = view.seen(np.concatenate([behind, place], axis=-2))
    curves = projected[..., -1, :] if view is None else projected[..., projected.shape[-2] // 2, :]
    for _ in range(2):
        curves = _farthest(projected, _outward(curves))
    return _segments(curves)


def _bowed_faces(mesh: Bricks, shapes: Shapes) -> Array:
    """Return the nodes (P, K, 2, stations, depth, 3) of the left and right face, from mid-depth to the depth face."""
    numbers = mesh.numbers
    sides = np.stack([numbers[:, 0], numbers[:, -1]])
    return np.asarray(mesh.nodes[sides] + shapes.displacement[:, :, sides])


def _flat_faces(model: BeamModel, shapes: Shapes) -> Array:
    """Return points (P, K, 2, stations, 3, 3) of the left and right face of a planar model, at three depths."""
    place = model.mesh.nodes + shapes.displacement
    sides = np.stack([place[:, :, model.mesh.row(0)], place[:, :, model.mesh.row(-1)]], axis=2)
    along = model.grid.straight_mm[model.mesh.row(0), 0]
    depth = 0.5 * model.grid.strip.depth_mm(along)[:, None] * np.linspace(0, 1, 3)
    lines = np.broadcast_to(sides[..., None, :], (*sides.shape[:-1], 3, 2))
    return np.concatenate([lines, np.broadcast_to(depth[..., None], (*lines.shape[:-1], 1))], axis=-1)


def _segments(sides: Array) -> Array:
    """Divide points (..., 2 S + 1, 2) into S quadratic segments (..., S, 3, 2)."""
    return np.stack([sides[..., 0:-1:2, :], sides[..., 1::2, :], sides[..., 2::2, :]], axis=-2)


def _outward(curves: Array) -> Array:
    """Return the outward normals (..., 2, n, 2) of the left and the right edge of the beam."""
    step = np.diff(curves, axis=-2)
    length = np.linalg.norm(step, axis=-1, keepdims=True)
    direction = step / length
    ahead = length[..., 1:, :] / (length[..., 1:, :] + length[..., :-1, :])
    inner = ahead * direction[..., :-1, :] + (1 - ahead) * direction[..., 1:, :]
    tangent = np.concatenate([direction[..., :1, :], inner, direction[..., -1:, :]], axis=-2)
    normal = np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)
    return np.asarray(normal * np.array([-1.0, 1.0])[:, None, None])


def _farthest(lines: Array, normal: Array) -> Array:
    """Return the point (..., n, 2) of each quadratic line (..., n, 2 D + 1, 2) that is farthest along the normal."""
    first, middle, last = lines[..., 0:-1:2, :], lines[..., 1::2, :], lines[..., 2::2, :]  # (..., n, D, 2)
    slope, bend = 0.5 * (last - first), first - 2 * middle + last
    along, curved = (np.einsum("...ndi,...ni->...nd", v, normal) for v in (slope, bend))
    top = np.clip(-along / np.where(curved < 0, curved, -1.0), -1.0, 1.0)
    top = np.where(curved < 0, top, np.where(along > 0, 1.0, -1.0))[..., None]
    places = middle + top * (slope + 0.5 * top * bend)
    best = np.argmax(np.einsum("...ndi,...ni->...nd", places, normal), axis=-1)
    return np.take_along_axis(places, best[..., None, None], axis=-2)[..., 0, :]


def points_on(curves: Array, per_segment: int) -> Array:
    """Return curves (..., S, 3, 2) as polylines (..., S * per_segment + 1, 2)."""
    xi = np.linspace(-1, 1, per_segment + 1)[:-1]
    shape = np.stack([0.5 * xi * (xi - 1), 1 - xi * xi, 0.5 * xi * (xi + 1)])
    inner = np.einsum("...sad,ax->...sxd", curves, shape)
    inner = inner.reshape(*curves.shape[:-3], -1, 2)
    return np.concatenate([inner, curves[..., -1, 2:3, :]], axis=-2)
