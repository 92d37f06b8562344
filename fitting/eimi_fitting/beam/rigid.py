"""The motion of a rigid body in the silicone, such as a magnet: two translations and a rotation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.bricks import Bricks
from eimi_fitting.beam.mesh import Indices, Mesh

Array = NDArray[np.float64]


class RigidBody:
    """The nodes of the mesh that move with a rigid body (the magnet)."""

    # The motion ``rigid`` (B, 3) is the translation (x, y) in mm and the rotation in rad, for B candidate laws.
    # ``nodes`` (T,): the nodes that move with the body.
    # ``arms`` (T, 2): the vectors (x, y) at rest from the reference point of the body to the nodes, in mm.
    # ``elements`` (H,): the elements that have at least one of the nodes.

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
        """Set the displacements of the magnet's nodes from the motion of the magnet, in place."""
        # ``displacement`` (B, N, d): of all N nodes in mm.
        c, s = np.cos(rigid[:, 2])[:, None], np.sin(rigid[:, 2])[:, None]
        x, y = self.arms.T
        displacement[:, self.nodes, 0] = rigid[:, 0:1] + (c - 1) * x - s * y
        displacement[:, self.nodes, 1] = rigid[:, 1:2] + s * x + (c - 1) * y

    def matrix(self, rigid: Array) -> Array:
        """Return the derivatives of element displacements with respect to the motion of the magnet."""
        # (H, B, u, 3): each of the H elements at the magnet has u displacements.
        c, s = np.cos(rigid[:, 2])[:, None], np.sin(rigid[:, 2])[:, None]
        tie = np.empty((len(self.elements), len(rigid), self._translation.shape[2], 3))
        tie[..., :2] = self._translation
        tie[..., 2] = self._cosine * c + self._sine * s
        return tie

    def stiffness_of_turning(self, force: Array, rigid: Array) -> Array:
        """Return the geometric stiffness of the magnet's rotation, from the element forces and its motion ``rigid``."""
        # ``force`` (E, B, u): of the elements. The result is (B,) in N mm.
        c, s = np.cos(rigid[:, 2])[:, None], np.sin(rigid[:, 2])[:, None]
        bending = self._sine * c - self._cosine * s  # second derivative of the tied displacements by the rotation
        return np.asarray(np.sum(bending * force[self.elements], axis=(0, 2)))


def dead_moment(tensor: Array, rigid: Array) -> tuple[Array, Array]:
    """Return the moment on the magnet due to loads with constant direction, and the stiffness that they cause."""
    # The potential is -Q : R, with the tensor Q (``tensor``, (B, 2, 2)) and the matrix R of the rotation. The results
    # are (B,).
    c, s = np.cos(rigid[:, 2]), np.sin(rigid[:, 2])
    even, odd = tensor[:, 0, 0] + tensor[:, 1, 1], tensor[:, 1, 0] - tensor[:, 0, 1]
    return c * odd - s * even, c * even + s * odd
