"""Pressure on a face: a load that stays normal to the face and proportional to the present length of the face."""

# The nodal forces are linear in the present positions of the nodes, and the tangent is a constant matrix times the
# pressure (Bonet and Wood, Nonlinear Continuum Mechanics for Finite Element Analysis, 2nd ed., section 8.5.2).

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.mesh import Indices, Mesh

Array = NDArray[np.float64]


class FollowerPressure:
    """Sides of elements on which a pressure acts, and the matrix that gives its nodal forces.

    Raises
    ------
    ValueError
        A side under pressure belongs to no element, or to two elements.
    """

    # ``elements`` (F,): the elements with a side under pressure.
    # ``operator`` (F, 18, 18): derivative of the nodal forces (N/mm) by the nodes' positions (mm), divided by the
    # pressure (N/mm²).

    def __init__(self, mesh: Mesh, nodes: Indices, spans: Array | None = None) -> None:
        # ``nodes`` (2 S + 1,): nodes along S sides of elements; the beam lies to the left of the direction from the
        # first to the last node. ``spans`` (S, 2): start and end of the loaded part of each side (-1 to 1); None: the
        # whole sides.
        sides = np.stack([nodes[0:-1:2], nodes[1::2], nodes[2::2]], axis=1)
        spans = np.tile([-1.0, 1.0], (len(sides), 1)) if spans is None else spans
        operator = np.zeros((len(mesh.elements), 2, 9, 2, 9))
        for side, (first, last) in zip(sides, spans, strict=True):
            if last <= first:
                continue
            holding = np.flatnonzero(np.isin(mesh.elements, side).sum(axis=1) == 3)
            if len(holding) != 1:
                x, y = mesh.nodes[side[1]]
                raise ValueError(
                    f"the pressure face contains ({x:g}, {y:g}) mm, which is not on a face of the silicone"
                )
            local = np.array([np.flatnonzero(mesh.elements[holding[0]] == node)[0] for node in side])
            xi = 0.5 * (first + last) + 0.5 * (last - first) / np.sqrt(3) * np.array([-1.0, 1.0])  # exact for cubics
            values = np.stack([0.5 * xi * (xi - 1), 1 - xi * xi, 0.5 * xi * (xi + 1)])
            slopes = np.stack([xi - 0.5, -2 * xi, xi + 0.5])
            share = 0.5 * (last - first) * values @ slopes.T  # integral of N_a dN_b/dxi
            a, b = np.meshgrid(local, local, indexing="ij")
            # The matrix is symmetric except for two skew-symmetric entries at each end of the face (Bonet and Wood,
            # Eq. 8.25b).
            operator[holding[0], 0, a, 1, b] -= share
            operator[holding[0], 1, a, 0, b] += share
        self.elements = np.flatnonzero(np.abs(operator).max(axis=(1, 2, 3, 4)) > 0)
        self.operator = operator[self.elements].reshape(-1, 18, 18)
        self._rest = mesh.nodes[mesh.elements[self.elements]].transpose(0, 2, 1).reshape(-1, 1, 18)

    def press(self, pressure: Array, nodal: Array, force: Array, stiffness: Array) -> None:
        """Subtract the nodal forces of a pressure and their derivative from ``force`` and ``stiffness``, in place."""
        # ``pressure`` (B,) or (1,): in N/mm² for B candidate laws. ``nodal`` (E, B, 18): displacements in mm.
        # ``force``: (E, B, 18). ``stiffness``: (E, B, 18, 18).
        tangent = pressure[:, None, None] * self.operator[:, None]  # (F, B, 18, 18)
        place = self._rest + nodal[self.elements]
        force[self.elements] -= np.matmul(tangent, place[..., None])[..., 0]
        stiffness[self.elements] -= tangent
