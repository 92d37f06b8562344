"""The edges that a camera sees of a simulated beam, as curves of quadratic segments in the beam frame.

A planar model has one line on each side. A solid's face is seen as its outermost places: of a bent beam, whose section
bows (anticlastic bending; Timoshenko and Goodier, Theory of Elasticity, section 102), the line along the depth faces on
the convex side, the one in mid-depth on the concave side.
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
    """(P, K, 2, S, 3, 2): left (y < 0 at rest) and right edge as S quadratic segments of three points, clamp to tip.

    Each element side is one segment, a full-width magnet's side too, which stays straight.
    """
    place = model.mesh.nodes + shapes.displacement
    return _segments(np.stack([place[:, :, model.mesh.row(0)], place[:, :, model.mesh.row(-1)]], axis=2))


def outline(model: Model, shapes: Shapes, view: View | None = None) -> Array:
    """(P, K, 2, S, 3, 2): left and right outline of the beam, as `edge_curves`; view: None for a telecentric lens.

    At each station along the beam it is the place of the face, at any depth, that lies farthest out along the
    outline's normal: the envelope of the face's lines. A planar model's faces are flat. Raises ValueError where the
    specimen reaches the pupil.
    """
    if isinstance(model, BeamModel):
        if view is None:
            return edge_curves(model, shapes)
        place = _flat_faces(model, shapes)
    else:
        place = _bowed_faces(model.mesh, shapes)
    if view is None:
        seen = place[..., :2]
    else:
        if not np.abs(place[..., 2]).max() < view.stand_off_mm:
            raise ValueError(f"a stand-off of {view.stand_off_mm:g} mm is within the specimen")
        behind = place[..., :0:-1, :] * [1.0, 1.0, -1.0]
        seen = view.seen(np.concatenate([behind, place], axis=-2))
    found = seen[..., -1, :] if view is None else seen[..., seen.shape[-2] // 2, :]
    for _ in range(2):
        found = _farthest(seen, _outward(found))
    return _segments(found)


def _bowed_faces(mesh: Bricks, shapes: Shapes) -> Array:
    """(P, K, 2, stations, depth, 3): nodes of the left and the right face, from mid-depth to the near depth face."""
    numbers = mesh.numbers
    sides = np.stack([numbers[:, 0], numbers[:, -1]])
    return np.asarray(mesh.nodes[sides] + shapes.displacement[:, :, sides])


def _flat_faces(model: BeamModel, shapes: Shapes) -> Array:
    """The same of a planar model, at three depths."""
    place = model.mesh.nodes + shapes.displacement
    sides = np.stack([place[:, :, model.mesh.row(0)], place[:, :, model.mesh.row(-1)]], axis=2)
    depth = np.linspace(0, 0.5 * model.specimen.depth_mm, 3)
    every = np.broadcast_to(sides[..., None, :], (*sides.shape[:-1], 3, 2))
    return np.concatenate([every, np.broadcast_to(depth[:, None], (*every.shape[:-1], 1))], axis=-1)


def _segments(sides: Array) -> Array:
    """(..., 2 S + 1, 2) -> (..., S, 3, 2)."""
    return np.stack([sides[..., 0:-1:2, :], sides[..., 1::2, :], sides[..., 2::2, :]], axis=-2)


def _outward(curves: Array) -> Array:
    """(..., 2, n, 2): normals of left and right curves (..., 2, n, 2) that point out of the beam between them."""
    step = np.diff(curves, axis=-2)
    length = np.linalg.norm(step, axis=-1, keepdims=True)
    direction = step / length
    ahead = length[..., 1:, :] / (length[..., 1:, :] + length[..., :-1, :])
    inner = ahead * direction[..., :-1, :] + (1 - ahead) * direction[..., 1:, :]
    tangent = np.concatenate([direction[..., :1, :], inner, direction[..., -1:, :]], axis=-2)
    normal = np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)
    return np.asarray(normal * np.array([-1.0, 1.0])[:, None, None])


def _farthest(seen: Array, normal: Array) -> Array:
    """(..., n, 2): of the quadratic lines through places (..., n, 2 D + 1, 2), the place farthest along normals."""
    first, middle, last = seen[..., 0:-1:2, :], seen[..., 1::2, :], seen[..., 2::2, :]  # (..., n, D, 2)
    slope, bend = 0.5 * (last - first), first - 2 * middle + last
    along, curved = (np.einsum("...ndi,...ni->...nd", v, normal) for v in (slope, bend))
    top = np.clip(-along / np.where(curved < 0, curved, -1.0), -1.0, 1.0)
    top = np.where(curved < 0, top, np.where(along > 0, 1.0, -1.0))[..., None]
    places = middle + top * (slope + 0.5 * top * bend)
    best = np.argmax(np.einsum("...ndi,...ni->...nd", places, normal), axis=-1)
    return np.take_along_axis(places, best[..., None, None], axis=-2)[..., 0, :]


def points_on(curves: Array, per_segment: int) -> Array:
    """(..., S, 3, 2) -> (..., S * per_segment + 1, 2): the curve as a fine polyline."""
    xi = np.linspace(-1, 1, per_segment + 1)[:-1]
    shape = np.stack([0.5 * xi * (xi - 1), 1 - xi * xi, 0.5 * xi * (xi + 1)])
    inner = np.einsum("...sad,ax->...sxd", curves, shape)
    inner = inner.reshape(*curves.shape[:-3], -1, 2)
    return np.concatenate([inner, curves[..., -1, 2:3, :]], axis=-2)
