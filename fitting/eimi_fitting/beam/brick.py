"""The solid element: a hexahedron with 27 nodes, quadratic displacement and linear, discontinuous pressure.

It has two Gauss points along the beam, three across and three in depth. All elements and candidate laws are evaluated
together. The first axis of a symmetric tensor has the components 11, 22, 33, 12, 23, 13.
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
    """Integrals and derivatives of the shape functions of a solid mesh."""

    # E elements with q Gauss points each.

    # (E, 27, 3 q): derivatives of the shape functions by x, y and z at the Gauss points, in 1/mm.
    gradient: Array
    # (E, 3 q, 27): transpose of ``gradient`` multiplied by ``weights``.
    weighted: Array
    # (E, q, 4): the four pressure functions at the Gauss points.
    basis: Array
    # (E, 4): integrals of the squares of the pressure functions in mm³.
    mass: Array
    # (E, 27): integrals of the shape functions in mm³.
    load: Array
    # (E, 27, 3): integrals of the derivatives of the shape functions in mm².
    slope: Array
    # (E, q): weights of the Gauss points in mm³.
    weights: Array


def operators(mesh: Bricks) -> Operators:
    """Compute the integrals and derivatives of the shape functions of a mesh of hexahedra.

    Raises
    ------
    ValueError
        An element is folded.
    """
    rules = [np.polynomial.legendre.leggauss(n) for n in (2, 3, 3)]
    places = [g.ravel() for g in np.meshgrid(*(r[0] for r in rules), indexing="ij")]
    values, local = shape_functions(*places)
    x = mesh.nodes[mesh.elements]  # (E, 27, 3)
    jacobian = np.einsum("eai,qar->eqir", x, local)
    det = np.linalg.det(jacobian)
    if np.any(det <= 0):
        first = int(np.argmax((det <= 0).any(axis=1)))
        raise ValueError(f"element {first} of the mesh is folded: check the rest shape of the specimen")
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
    """Return whether the pressure is an unknown: always True for solid elements."""
    return True


def gradients(ops: Operators, nodal: Array) -> Array:
    """Return the displacement gradient du_i/dX_j at all Gauss points."""
    # ``nodal`` (E, B, 3, 27): displacements in mm, for E elements and B candidate laws. The result is (3, 3, E, B, q).
    n, b = nodal.shape[:2]
    h = np.matmul(nodal.reshape(n, b * 3, 27), ops.gradient)
    return np.ascontiguousarray(h.reshape(n, b, 3, 3, POINTS).transpose(2, 3, 0, 1, 4))


def stretch(ops: Operators, nodal: Array) -> Array:
    """Return the largest principal stretch at all Gauss points."""
    # ``nodal`` (E, B, 3, 27): displacements in mm. The result is (E, B, q).
    F = gradients(ops, nodal)
    F[range(3), range(3)] += 1
    a, b, c, d, e, f = isotropy.right_cauchy_green(F)
    # The largest eigenvalue in closed form (Smith 1961, Communications of the ACM 4:168).
    mean = (a + b + c) / 3
    a, b, c = a - mean, b - mean, c - mean
    size = np.sqrt((a * a + b * b + c * c + 2 * (d * d + e * e + f * f)) / 6)
    determinant = a * (b * c - e * e) + d * (e * f - c * d) + f * (d * e - b * f)
    cosine = np.clip(0.5 * determinant / np.maximum(size, _SMALLEST) ** 3, -1.0, 1.0)
    return np.asarray(np.sqrt(mean + 2 * size * np.cos(np.arccos(cosine) / 3)))


class Evaluation(NamedTuple):
    """Forces, stresses and strains of all elements."""

    # E elements with q Gauss points each, for B candidate laws.

    # (E, B, 3, 27): internal forces on the nodes in N.
    force: Array
    # (3, 3, E, B, q): deformation gradient.
    F: Array
    # (E, B, q): determinant of F.
    J: Array
    # (6, E, B, q): second Piola-Kirchhoff stress in MPa.
    S: Array
    # (6, 6, E, B, q): derivative of S by the Green strain, in MPa.
    D: Array
    # (6, E, B, q): derivative of S by the pressure.
    volume: Array
    # (B,): whether J exceeds 0.001 at all Gauss points.
    valid: NDArray[np.bool_]


def evaluate(ops: Operators, batch: Batch, nodal: Array, pressure: Array) -> Evaluation:
    """Compute the forces and stresses of all elements."""
    # ``nodal`` (E, B, 3, 27): displacements in mm. ``pressure`` (E, B, 4): coefficients of the pressure functions in
    # MPa.
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
    """Return the tangent stiffness of all elements at constant pressure in N/mm."""
    # ``predicted`` (6, E, B, q): the stress for the geometric part of the stiffness in MPa. The result is (E, B, 81,
    # 81).
    return np.concatenate(list(tangents(ops, ev, predicted)))


def tangents(ops: Operators, ev: Evaluation, predicted: Array) -> Iterator[Array]:
    """Yield the tangent stiffness of one group of elements after another; see `stiffness`."""
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
    """Return the derivatives of the elements' volumes with respect to the nodal displacements in mm²."""
    # (E, B, 81, 4): the volume is weighted by each of four pressure functions.
    n, b = ev.J.shape[:2]
    cofactor = isotropy.turned(ev.F, ev.volume).transpose(2, 3, 0, 1, 4).reshape(n, b * 3, 3 * POINTS)
    coupling = np.empty((n, b * 3, 108))
    for some in _parts(n):
        weighted, basis = ops.weighted[some].reshape(-1, 3, POINTS, 27, 1), ops.basis[some, None, :, None]
        np.matmul(cofactor[some], (weighted * basis).reshape(-1, 3 * POINTS, 108), out=coupling[some])
    return coupling.reshape(n, b, 81, 4)


def _parts(elements: int) -> list[slice]:
    """Divide the elements into groups of at most `AT_ONCE` elements."""
    return [slice(first, first + AT_ONCE) for first in range(0, elements, AT_ONCE)]


def predict_stress(ops: Operators, ev: Evaluation, step: Array, pressure_step: Array) -> Array:
    """Return the second Piola-Kirchhoff stress in MPa after a linear step."""
    # ``step`` (E, B, 3, 27): changes of the displacements in mm. ``pressure_step`` (E, B, 4): changes of the pressures
    # in MPa. The result is (6, E, B, q).
    h = gradients(ops, step)
    g = np.stack([[(ev.F[:, I] * h[:, J]).sum(axis=0) for J in range(3)] for I in range(3)])
    twice = [g[0, 0], g[1, 1], g[2, 2], g[0, 1] + g[1, 0], g[1, 2] + g[2, 1], g[0, 2] + g[2, 0]]
    dp = np.matmul(pressure_step, ops.basis.transpose(0, 2, 1))
    return np.asarray(ev.S + sum(ev.D[:, v] * twice[v] for v in range(6)) + dp * ev.volume)
