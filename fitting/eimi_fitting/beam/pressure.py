"""Pressure on a face: a load that stays normal to the face and proportional to the present length of the face.

The pressure p acts on a side of an element of a planar body. Let xi be the coordinate along the side, x(xi) the present
position of the side and N_a the shape function of node a. The force on node a is a linear function of the present
positions of the nodes:

    f_a = p * integral of N_a (-dx_2/dxi, dx_1/dxi) dxi.

The exact tangent is therefore p times a constant matrix (Bonet and Wood, Nonlinear Continuum Mechanics for Finite
Element Analysis, 2nd ed., section 8.5.2). The matrix is symmetric except for two skew-symmetric entries at each end of
the face (Eq. 8.25b of the same book), because a free end makes the load non-conservative.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.mesh import Indices, Mesh

Array = NDArray[np.float64]


class FollowerPressure:
    """The sides of elements on which a pressure acts, and the matrix that gives the nodal forces of this pressure.

    Parameters
    ----------
    mesh : Mesh
        The planar mesh.
    nodes : ndarray of int, shape (2 S + 1,)
        Nodes along the S sides of elements, ordered so that the beam lies to the left of the direction from the first
        node to the last.
    spans : ndarray, shape (S, 2), or None
        Start and end of the part of each side that is under pressure, in the side's coordinate xi from -1 to 1; None:
        the whole sides.

    Attributes
    ----------
    elements : ndarray of int, shape (F,)
        The F elements with a side under pressure.
    operator : ndarray, shape (F, 18, 18)
        The product of this matrix, the present positions of an element's nodes in mm and the pressure in N/mm² is the
        vector of nodal forces in N per mm of depth.

    Raises
    ------
    ValueError
        A side under pressure belongs to no element, or to two elements.
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
            operator[holding[0], 0, a, 1, b] -= share
            operator[holding[0], 1, a, 0, b] += share
        self.elements = np.flatnonzero(np.abs(operator).max(axis=(1, 2, 3, 4)) > 0)
        self.operator = operator[self.elements].reshape(-1, 18, 18)
        self._rest = mesh.nodes[mesh.elements[self.elements]].transpose(0, 2, 1).reshape(-1, 1, 18)

    def press(self, pressure: Array, nodal: Array, force: Array, stiffness: Array) -> None:
        """Subtract the nodal forces of a pressure from ``force``, and the derivative of the forces from ``stiffness``.

        There are E elements and B candidate laws.

        Parameters
        ----------
        pressure : ndarray, shape (B,) or (1,)
            Pressure on the face in N/mm².
        nodal : ndarray, shape (E, B, 18)
            Displacements of the elements' nodes in mm.
        force : ndarray, shape (E, B, 18)
            Internal forces of the elements, changed in place.
        stiffness : ndarray, shape (E, B, 18, 18)
            Stiffness matrices of the elements, changed in place.
        """
        tangent = pressure[:, None, None] * self.operator[:, None]  # (F, B, 18, 18)
        place = self._rest + nodal[self.elements]
        force[self.elements] -= np.matmul(tangent, place[..., None])[..., 0]
        stiffness[self.elements] -= tangent
