"""Pressure on a face: a load that follows the face, always normal to it and as strong as the face is long.

On a planar body the force of a pressure p on the nodes of a side is linear in where they are: with the side's places
x(xi), f_a = p * integral of N_a (-dx_2/dxi, dx_1/dxi), so the exact tangent is p times a constant matrix (Bonet and
Wood, Nonlinear Continuum Mechanics for Finite Element Analysis, 2nd ed., section 8.5.2). It is symmetric but for a
skew pair at each of the two ends of the face (their Eq. 8.25b): a free end makes the load non-conservative.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.mesh import Indices, Mesh

Array = NDArray[np.float64]


class FollowerPressure:
    """The element sides under pressure and what the pressure's forces are made of.

    nodes: (2 S + 1,) along the S sides in order, the body to their left; spans: (S, 2) the part of each side under
    pressure in its own coordinate, -1 to 1 where it is the whole. elements: (F,) those that hold the sides;
    operator: (F, 18, 18), nodal places (i, node) -> forces at unit pressure. Raises ValueError where a side under
    pressure belongs to no element.
    """

    def __init__(self, mesh: Mesh, nodes: Indices, spans: Array | None = None) -> None:
        sides = np.stack([nodes[0:-1:2], nodes[1::2], nodes[2::2]], axis=1)
        spans = np.tile([-1.0, 1.0], (len(sides), 1)) if spans is None else spans
        operator = np.zeros((len(mesh.elements), 2, 9, 2, 9))
        for side, (first, last) in zip(sides, spans, strict=True):
            if last <= first:
                continue
            holding = np.flatnonzero(np.isin(mesh.elements, side).sum(axis=1) == 3)
            if len(holding) != 1:
                raise ValueError(f"the side at {mesh.nodes[side[1]]} mm is no face of the silicone")
            local = np.array([np.flatnonzero(mesh.elements[holding[0]] == node)[0] for node in side])
            xi = 0.5 * (first + last) + 0.5 * (last - first) / np.sqrt(3) * np.array([-1.0, 1.0])  # exact for cubics
            values = np.stack([0.5 * xi * (xi - 1), 1 - xi * xi, 0.5 * xi * (xi + 1)])
            slopes = np.stack([xi - 0.5, -2 * xi, xi + 0.5])
            share = 0.5 * (last - first) * values @ slopes.T  # integral of N_a dN_b/dxi
            a, b = np.meshgrid(local, local, indexing="ij")
            operator[holding[0], 0, a, 1, b] -= share
            operator[holding[0], 1, a, 0, b] += share
        self.elements = np.flatnonzero(np.abs(operator).max(axis=(1, 2, 3, 4)) > 0)
        self.operator = operator[self.elements].reshape(-1, 18, 18)
        self._rest = mesh.nodes[mesh.elements[self.elements]].transpose(0, 2, 1).reshape(-1, 1, 18)

    def press(self, pressure: Array, nodal: Array, force: Array, stiffness: Array) -> None:
        """Take the forces of the pressures (B,) or (1,) in N/mm² from internal forces (E, B, 18), their tangent from
        stiffnesses (E, B, 18, 18); nodal: displacements (E, B, 18).
        """
        tangent = pressure[:, None, None] * self.operator[:, None]  # (F, B, 18, 18)
        place = self._rest + nodal[self.elements]
        force[self.elements] -= np.matmul(tangent, place[..., None])[..., 0]
        stiffness[self.elements] -= tangent
