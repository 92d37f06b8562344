"""A rigid end: nodes that a body of three unknowns carries along, two translations and a rotation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.mesh import Indices, Mesh

Array = NDArray[np.float64]


class RigidEnd:
    """The kinematics of the tied nodes and of the elements that hold them.

    nodes: the tied nodes; arms: (T, 2) mm from the reference point at rest; elements: (Et,) those with tied nodes,
    three each. In these elements the body's unknowns (U_x, U_y, theta) take the places of the tied nodes' x components,
    the places of their y components stay empty: see ``number``.
    """

    def __init__(self, mesh: Mesh, nodes: Indices, centre: tuple[float, float]) -> None:
        self.nodes = nodes
        self.arms = mesh.nodes[nodes] - np.asarray(centre)
        tied = np.zeros(len(mesh.nodes), bool)
        tied[nodes] = True
        self.elements = np.flatnonzero(tied[mesh.elements].any(axis=1))
        self.local = np.array([np.flatnonzero(row) for row in tied[mesh.elements[self.elements]]])  # (Et, 3)
        e = len(self.elements)
        constant, cosine, sine = np.zeros((3, e, 2, 9, 2, 9))
        for k, bound in enumerate(self.local):
            free = np.setdiff1d(np.arange(9), bound)
            x, y = (mesh.nodes[mesh.elements[self.elements[k], bound]] - np.asarray(centre)).T
            for i in range(2):
                constant[k, i, free, i, free] = 1.0
                constant[k, i, bound, 0, bound[i]] = 1.0
            # Column of the rotation: dR/dtheta times the arm.
            cosine[k, 0, bound, 0, bound[2]], cosine[k, 1, bound, 0, bound[2]] = -y, x
            sine[k, 0, bound, 0, bound[2]], sine[k, 1, bound, 0, bound[2]] = -x, -y
        self._constant, self._cosine, self._sine = (a.reshape(e, 1, 18, 18) for a in (constant, cosine, sine))
        place = {int(node): k for k, node in enumerate(nodes)}
        self._index = np.array(
            [[place[int(n)] for n in mesh.elements[e, b]] for e, b in zip(self.elements, self.local, strict=True)]
        )

    def number(self, dofs: Indices, first: int) -> None:
        """Write the body's unknowns first, first + 1, first + 2 into the element numbering (E, 2, 9)."""
        for e, bound in zip(self.elements, self.local, strict=True):
            dofs[e, :, bound] = -1
            dofs[e, 0, bound] = first + np.arange(3)

    def carry(self, displacement: Array, rigid: Array) -> None:
        """Put the tied nodes of (B, N, 2) where the body (B, 3) carries them."""
        c, s = np.cos(rigid[:, 2])[:, None], np.sin(rigid[:, 2])[:, None]
        x, y = self.arms.T
        displacement[:, self.nodes, 0] = rigid[:, 0:1] + (c - 1) * x - s * y
        displacement[:, self.nodes, 1] = rigid[:, 1:2] + s * x + (c - 1) * y

    def matrix(self, rigid: Array) -> Array:
        """(Et, B, 18, 18): derivative of the local displacements with respect to the elements' unknowns."""
        c, s = np.cos(rigid[:, 2])[:, None, None], np.sin(rigid[:, 2])[:, None, None]
        return self._constant + self._cosine * c + self._sine * s

    def spread(self, element_step: Array, rigid_step: Array, matrix: Array) -> None:
        """Give the tied nodes of (E, B, 18) their share of the body's linear step (B, 3)."""
        part = element_step[self.elements].reshape(len(self.elements), -1, 2, 9)
        for k, bound in enumerate(self.local):
            part[k][:, 0, bound] = rigid_step
            part[k][:, 1, bound] = 0.0
        shape = (len(self.elements), -1, 18)
        element_step[self.elements] = np.matmul(matrix, part.reshape(*shape, 1)).reshape(shape)

    def stiffness_of_turning(self, force: Array, rigid: Array) -> Array:
        """(B,): what the internal forces (E, B, 18) on the tied nodes add to the rotation's stiffness."""
        b = len(rigid)
        total = np.zeros((b, len(self.nodes), 2))
        for k, e in enumerate(self.elements):
            total[:, self._index[k]] += force[e].reshape(b, 2, 9)[:, :, self.local[k]].transpose(0, 2, 1)
        c, s = np.cos(rigid[:, 2])[:, None], np.sin(rigid[:, 2])[:, None]
        x, y = self.arms.T
        turned = total[:, :, 0] * (c * x - s * y) + total[:, :, 1] * (s * x + c * y)
        return np.asarray(-turned.sum(axis=1))


def dead_moment(tensor: Array, rigid: Array) -> tuple[Array, Array]:
    """Moment (B,) of a dead load with the potential -tensor : R(theta), and its stiffness (B,)."""
    c, s = np.cos(rigid[:, 2]), np.sin(rigid[:, 2])
    even, odd = tensor[:, 0, 0] + tensor[:, 1, 1], tensor[:, 1, 0] - tensor[:, 0, 1]
    return c * odd - s * even, c * even + s * odd
