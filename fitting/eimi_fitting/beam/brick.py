"""The 27-node hexahedron: quadratic displacement, linear discontinuous pressure, for a whole batch.

The hexahedron is the solid counterpart of `eimi_fitting.beam.element`, with the same potential, axes and functions.
There are two Gauss points along the beam, three across and three in depth. If the displacement in depth is held the
element is that of plane strain.

Symmetric tensors have six components 11, 22, 33, 12, 23, 13, which are the first axis, as in
`eimi_fitting.beam.isotropy`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam import isotropy
from eimi_fitting.beam.bricks import Bricks, shape_functions
from eimi_fitting.beam.element import SMALLEST_J, Batch, orthogonal_basis
from eimi_fitting.beam.isotropy import PLACE

Array = NDArray[np.float64]

POINTS = 18  # Gauss points of an element
_SMALLEST = 1e-100  # its cube is not yet zero in floating point
AT_ONCE = 64  # elements whose tangents are computed together; more take no less time, but more memory
_PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


@dataclass(frozen=True)
class Operators:
    """The operators that depend on the geometry only, computed once for a mesh.

    gradient: (E, 27, 3 q) gives gradients (I, q) of nodal values; weighted: (E, 3 q, 27) its transpose times weights;
    basis: (E, q, 4) pressure functions at the Gauss points; mass: (E, 4) their weighted squares; load: (E, 27) and
    slope: (E, 27, 3) integrals of the shape functions and of their derivatives; weights: (E, q) mm³.

    The other orders of the same values are made where they are used, for a few elements at a time: for the solid of a
    virtual beam they would fill 34 MB.
    """

    gradient: Array
    weighted: Array
    basis: Array
    mass: Array
    load: Array
    slope: Array
    weights: Array


def operators(mesh: Bricks) -> Operators:
    """Return the operators of a mesh. Raises ValueError if an element is folded."""
    rules = [np.polynomial.legendre.leggauss(n) for n in (2, 3, 3)]
    places = [g.ravel() for g in np.meshgrid(*(r[0] for r in rules), indexing="ij")]
    values, local = shape_functions(*places)
    x = mesh.nodes[mesh.elements]  # (E, 27, 3)
    jacobian = np.einsum("eai,qar->eqir", x, local)
    det = np.linalg.det(jacobian)
    if np.any(det <= 0):
        raise ValueError(f"element {int(np.argmax((det <= 0).any(axis=1)))} of the mesh is folded")
    weights = det * np.einsum("i,j,k->ijk", *(r[1] for r in rules)).ravel()
    slope = np.einsum("qar,eqrI->eqaI", local, np.linalg.inv(jacobian), optimize=True)  # dN_a/dX_I
    n = len(x)
    weighted = slope * weights[:, :, None, None]
    basis, mass = orthogonal_basis(weights, np.stack([np.ones(POINTS), *places], axis=1))
    return Operators(
        slope.transpose(0, 2, 3, 1).reshape(n, 27, 3 * POINTS),
        weighted.transpose(0, 3, 1, 2).reshape(n, 3 * POINTS, 27),
        basis,
        mass,
        np.einsum("eq,qa->ea", weights, values),
        weighted.sum(axis=1),
        weights,
    )


def mixed(batch: Batch) -> bool:
    """Return True: the pressure of a solid element is always an unknown."""
    return True


def gradients(ops: Operators, nodal: Array) -> Array:
    """Return the displacement gradients (i, I, E, B, q) of nodal displacements (E, B, 3, 27)."""
    n, b = nodal.shape[:2]
    h = np.matmul(nodal.reshape(n, b * 3, 27), ops.gradient)
    return np.ascontiguousarray(h.reshape(n, b, 3, 3, POINTS).transpose(2, 3, 0, 1, 4))


def stretch(ops: Operators, nodal: Array) -> Array:
    """Return the largest principal stretch (E, B, q) at every Gauss point.

    The largest eigenvalue of C is computed in closed form (Smith 1961, Communications of the ACM 4:168). If two
    eigenvalues are equal, the relative error of the strain is 1e-8. LAPACK takes eight times as long for such matrices.
    """
    F = gradients(ops, nodal)
    F[range(3), range(3)] += 1
    a, b, c, d, e, f = isotropy.right_cauchy_green(F)
    mean = (a + b + c) / 3
    a, b, c = a - mean, b - mean, c - mean
    size = np.sqrt((a * a + b * b + c * c + 2 * (d * d + e * e + f * f)) / 6)
    determinant = a * (b * c - e * e) + d * (e * f - c * d) + f * (d * e - b * f)
    cosine = np.clip(0.5 * determinant / np.maximum(size, _SMALLEST) ** 3, -1.0, 1.0)
    return np.asarray(np.sqrt(mean + 2 * size * np.cos(np.arccos(cosine) / 3)))


class Evaluation(NamedTuple):
    """The elements of a batch at one displacement, with all quantities of a Newton step and of the stress prediction.

    force: (E, B, 3, 27) internal nodal forces; F: (i, I, E, B, q); J: (E, B, q); S: (6, E, B, q) second Piola-Kirchhoff
    stress; D: (6, 6, E, B, q) its derivative by the Green strain; volume: (6, E, B, q) its derivative by the pressure;
    valid: (B,) every element unfolded.
    """

    force: Array
    F: Array
    J: Array
    S: Array
    D: Array
    volume: Array
    valid: NDArray[np.bool_]


def evaluate(ops: Operators, batch: Batch, nodal: Array, pressure: Array) -> Evaluation:
    """Return the internal forces and stresses for nodal displacements (E, B, 3, 27) and pressures (E, B, 4)."""
    F = gradients(ops, nodal)
    F[range(3), range(3)] += 1
    J = _determinant(F)
    valid = np.asarray(np.isfinite(F).all(axis=(0, 1, 2, 4)) & (J > SMALLEST_J).all(axis=(0, 2)))
    if not valid.all():  # keep the arithmetic of failed candidates finite; their status says that they failed
        F = np.where(valid[:, None], F, np.eye(3)[:, :, None, None, None])
        J = np.where(valid[:, None], J, 1.0)
    S, D, volume = isotropy.response(batch.law, batch.parameters[:, None, :], F, J)
    p = np.matmul(pressure, ops.basis.transpose(0, 2, 1))
    isotropy.add_pressure(p, volume, J, S, D)
    n, b = nodal.shape[:2]
    P = np.empty((n, b, 3, 3, POINTS))
    P[...] = isotropy.turned(F, S).transpose(2, 3, 0, 1, 4)
    force = np.matmul(P.reshape(n, b * 3, 3 * POINTS), ops.weighted).reshape(n, b, 3, 27)
    return Evaluation(force, F, J, S, D, volume, valid)


def _determinant(F: Array) -> Array:
    (a, b, c), (d, e, f), (g, h, i) = F
    return np.asarray(a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g))


def stiffness(ops: Operators, ev: Evaluation, predicted: Array) -> Array:
    """Return the tangents (E, B, 81, 81), ordered (i, node), without the part of the pressure.

    The geometric part uses the predicted stress (6, E, B, q); see `beam.equilibrium`.
    """
    return np.concatenate(list(tangents(ops, ev, predicted)))


def tangents(ops: Operators, ev: Evaluation, predicted: Array) -> Iterator[Array]:
    """Yield the tangents of `stiffness` in parts of `AT_ONCE` elements."""
    for some in _parts(len(ops.basis)):
        F, D = ev.F[:, :, some], ev.D[:, :, some]
        n, b = F.shape[2:4]
        # A_iIjJ = F_iK D_KILJ F_jL + delta_ij S_IJ, for i <= j.
        half = sum(F[:, k, None, None] * D[PLACE[k]] for k in range(3))  # (i, I, 6, E, B, q)
        T = np.empty((n, b, POINTS, 3, 6, 3))  # E, B, q, I, pair ij, J
        for pair, (i, j) in enumerate(_PAIRS):
            A = sum(half[i][:, PLACE[k]] * F[j, k] for k in range(3))  # (I, J, E, B, q)
            if i == j:
                A += predicted[:, some][PLACE]
            T[..., pair, :] = A.transpose(2, 3, 4, 0, 1)
        slopes = ops.gradient[some].reshape(n, 27, 3, POINTS).transpose(0, 3, 2, 1).copy()  # (E, q, I, 27)
        weighted = ops.weighted[some].reshape(n, 3, POINTS, 27).transpose(0, 3, 2, 1).reshape(n, 27, 3 * POINTS)
        half_way = np.matmul(T.reshape(n, b, POINTS, 18, 3), slopes[:, None])  # (E, B, q, 18, 27)
        blocks = np.matmul(weighted[:, None], half_way.reshape(n, b, 3 * POINTS, 162)).reshape(n, b, 27, 6, 27)
        K = np.empty((n, b, 3, 27, 3, 27))
        for pair, (i, j) in enumerate(_PAIRS):
            K[:, :, i, :, j, :] = blocks[:, :, :, pair]
            if i != j:
                K[:, :, j, :, i, :] = blocks[:, :, :, pair].swapaxes(-1, -2)
        yield K.reshape(n, b, 81, 81)


def volume_coupling(ops: Operators, ev: Evaluation) -> Array:
    """Return the derivative (E, B, 81, 4) of the volume residual with respect to the displacement."""
    n, b = ev.J.shape[:2]
    cofactor = isotropy.turned(ev.F, ev.volume).transpose(2, 3, 0, 1, 4).reshape(n, b * 3, 3 * POINTS)
    coupling = np.empty((n, b * 3, 108))
    for some in _parts(n):
        weighted, basis = ops.weighted[some].reshape(-1, 3, POINTS, 27, 1), ops.basis[some, None, :, None]
        np.matmul(cofactor[some], (weighted * basis).reshape(-1, 3 * POINTS, 108), out=coupling[some])
    return coupling.reshape(n, b, 81, 4)


def _parts(elements: int) -> list[slice]:
    """Return slices of the elements of a mesh, with `AT_ONCE` elements in each but the last."""
    return [slice(first, first + AT_ONCE) for first in range(0, elements, AT_ONCE)]


def predict_stress(ops: Operators, ev: Evaluation, step: Array, pressure_step: Array) -> Array:
    """Return the stress S + D : dE, (6, E, B, q), after a linear step (E, B, 3, 27) and a pressure step (E, B, 4)."""
    h = gradients(ops, step)
    g = np.stack([[(ev.F[:, I] * h[:, J]).sum(axis=0) for J in range(3)] for I in range(3)])
    twice = [g[0, 0], g[1, 1], g[2, 2], g[0, 1] + g[1, 0], g[1, 2] + g[2, 1], g[0, 2] + g[2, 0]]
    dp = np.matmul(pressure_step, ops.basis.transpose(0, 2, 1))
    return np.asarray(ev.S + sum(ev.D[:, v] * twice[v] for v in range(6)) + dp * ev.volume)
