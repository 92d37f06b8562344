"""A rigid body in the silicone, such as a magnet. The motion has three unknowns: two translations and a rotation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.bricks import Bricks
from eimi_fitting.beam.mesh import Indices, Mesh

Array = NDArray[np.float64]


class RigidBody:
    """The kinematics of the nodes that move with a rigid body (a magnet), and of the elements that have such nodes.

    Let U be the translation of the body's reference point, R(theta) the matrix of its rotation theta, and s the vector
    from the reference point to a node at rest. The displacement of the node is U + (R(theta) - 1) s. The node does not
    move in depth.

    Attributes
    ----------
    nodes : ndarray of int, shape (T,)
        The T nodes that move with the body.
    arms : ndarray, shape (T, 2)
        The vectors s (x, y) from the reference point to the T nodes at rest, in mm.
    elements : ndarray of int, shape (Et,)
        The Et elements that have at least one of the T nodes.
    """

    def __init__(self, mesh: Mesh | Bricks, nodes: Indices, centre: tuple[float, float]) -> None:
        self.nodes = nodes
        self.arms = mesh.nodes[nodes, :2] - np.asarray(centre)
        tied = np.isin(mesh.elements, nodes)
        self.elements = np.flatnonzero(tied.any(axis=1))
        tied = tied[self.elements]
        arms = (mesh.nodes[mesh.elements[self.elements], :2] - np.asarray(centre)) * tied[..., None]
        (e, n), d = tied.shape, mesh.nodes.shape[1]
        translation = np.zeros((e, d, n, 2))
        translation[:, 0, :, 0] = translation[:, 1, :, 1] = tied
        self._translation = translation.reshape(e, 1, d * n, 2)
        # The rotation moves a node by R'(theta) times its arm: cos times the first, sin times the second.
        x, y, in_depth = arms[..., 0], arms[..., 1], [np.zeros((e, n))] * (d - 2)
        self._cosine = np.concatenate([-y, x, *in_depth], axis=1)[:, None]
        self._sine = np.concatenate([-x, -y, *in_depth], axis=1)[:, None]

    def carry(self, displacement: Array, rigid: Array) -> None:
        """Give the nodes of the rigid body (magnet) their displacements, in place.

        displacement: displacements of all N nodes with d coordinates for B candidate laws, (B, N, d) in mm. The rows of
        the nodes of the body are overwritten. rigid: translation (x, y) in mm and rotation in rad of the body for each
        candidate, (B, 3).
        """
        c, s = np.cos(rigid[:, 2])[:, None], np.sin(rigid[:, 2])[:, None]
        x, y = self.arms.T
        displacement[:, self.nodes, 0] = rigid[:, 0:1] + (c - 1) * x - s * y
        displacement[:, self.nodes, 1] = rigid[:, 1:2] + s * x + (c - 1) * y

    def matrix(self, rigid: Array) -> Array:
        """Return how the nodes of the elements at the rigid body move with it: a matrix of derivatives, (Et, B, u, 3).

        An entry is the derivative of one of the u displacements of an element by the translation (x, y) or the rotation
        of the body. It is zero for a node that does not belong to the body. There are B candidate laws, and Et elements
        with nodes of the body (the magnet with the silicone that moves rigidly with it). rigid: translation (x, y) in
        mm and rotation in rad of the body for each candidate, (B, 3).
        """
        c, s = np.cos(rigid[:, 2])[:, None], np.sin(rigid[:, 2])[:, None]
        tie = np.empty((len(self.elements), len(rigid), self._translation.shape[2], 3))
        tie[..., :2] = self._translation
        tie[..., 2] = self._cosine * c + self._sine * s
        return tie

    def stiffness_of_turning(self, force: Array, rigid: Array) -> Array:
        """Return the part of the body's rotational stiffness that is due to the forces on its nodes, (B,).

        A node of the rigid body (the magnet) moves on a circle when the body turns. The moment of a constant force on
        this node therefore changes with the rotation, and its derivative is a stiffness. force: the forces (E, B, u) on
        the u unknowns of each of E elements, for B candidate laws. rigid: translation (x, y) in mm and rotation in rad
        of the body for each candidate, (B, 3).
        """
        c, s = np.cos(rigid[:, 2])[:, None], np.sin(rigid[:, 2])[:, None]
        bending = self._sine * c - self._cosine * s  # second derivative of the tied displacements by the rotation
        return np.asarray(np.sum(bending * force[self.elements], axis=(0, 2)))


def dead_moment(tensor: Array, rigid: Array) -> tuple[Array, Array]:
    """Return the moment of a dead load on the rigid body (the magnet) and the stiffness of this load, (B,) each.

    A dead load keeps its direction and size while the body turns. Its potential is -Q : R(theta), with the tensor Q
    (``tensor``), the rotation theta of the body and the matrix R(theta) of this rotation. The moment is minus the first
    derivative of the potential by theta, and the stiffness is the second derivative. There are B candidate laws:
    ``tensor`` has the shape (B, 2, 2), or (1, 2, 2) for all candidates, and ``rigid`` (B, 3) has the translation of the
    body and theta.
    """
    c, s = np.cos(rigid[:, 2]), np.sin(rigid[:, 2])
    even, odd = tensor[:, 0, 0] + tensor[:, 1, 1], tensor[:, 1, 0] - tensor[:, 0, 1]
    return c * odd - s * even, c * even + s * odd
