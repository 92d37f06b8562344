"""The planar Q2/P1 element, evaluated for all elements and candidate laws together."""

# The displacement is quadratic, and the pressure p is linear and discontinuous (Sussman and Bathe 1987, Computers &
# Structures 26:357). The potential of an element is the integral of psi(F) + p (J - 1) - p^2 / (2 K), with the
# isochoric energy psi, the deformation gradient F, its determinant J and the bulk modulus K. An element has two Gauss
# points along the beam and three across.

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.mesh import Mesh, shape_functions
from eimi_fitting.laws.law import Law, PlanarEnergy, Section

Array = NDArray[np.float64]

POINTS = 6  # Gauss points of an element
AT_ONCE: int | None = None  # elements whose tangents are computed together: all


@dataclass(frozen=True)
class Operators:
    """Integrals and derivatives of the shape functions of a planar mesh."""

    # E elements with q Gauss points each.

    # (E, 9, 2 q): derivatives of the shape functions by x and y at the Gauss points, in 1/mm.
    gradient: Array
    # (E, 2 q, 9): transpose of ``gradient`` multiplied by ``weights``.
    weighted: Array
    # (E, 4 q, 81): products of two derivatives of shape functions, multiplied by ``weights``.
    tangent: Array
    # (E, 2 q, 27): products of a derivative of a shape function and a pressure function, multiplied by ``weights``.
    pressure: Array
    # (E, q, 3): the three pressure functions at the Gauss points.
    basis: Array
    # (E, 3): integrals of the squares of the pressure functions in mm².
    mass: Array
    # (E, 9): integrals of the shape functions in mm².
    load: Array
    # (E, 9, 2): integrals of the derivatives of the shape functions in mm.
    slope: Array
    # (E, q): weights of the Gauss points, multiplied by the relative thickness, in mm².
    weights: Array


def operators(mesh: Mesh) -> Operators:
    """Compute the integrals and derivatives of the shape functions of a planar mesh.

    Raises
    ------
    ValueError
        An element is folded.
    """
    # This rule is exact for cubic polynomials, and no mode of deformation has zero stiffness. It therefore preserves
    # the order of convergence of quadratic elements (Ciarlet 1978, section 4.1).
    along, weights_along = np.polynomial.legendre.leggauss(2)
    across, weights_across = np.polynomial.legendre.leggauss(3)
    xi, eta = (g.ravel() for g in np.meshgrid(along, across, indexing="ij"))
    values, slopes = shape_functions(xi, eta)
    x = mesh.nodes[mesh.elements]  # (E, 9, 2)
    jacobian = np.einsum("eai,qar->eqir", x, slopes)
    det = np.linalg.det(jacobian)
    if np.any(det <= 0):
        first = int(np.argmax((det <= 0).any(axis=1)))
        raise ValueError(f"element {first} of the mesh is folded: check the rest shape of the specimen")
    weights = det * np.outer(weights_along, weights_across).ravel()
    if mesh.thickness is not None:
        weights = weights * (mesh.thickness[mesh.elements] @ values.T)
    slope = np.einsum("qar,eqrI->eqaI", slopes, np.linalg.inv(jacobian))  # dN_a/dX_I
    n = len(x)
    gradient = slope.transpose(0, 2, 3, 1).reshape(n, 9, 2 * POINTS)
    weighted = (slope * weights[:, :, None, None]).transpose(0, 3, 1, 2).reshape(n, 2 * POINTS, 9)
    tangent = np.einsum("eq,eqaI,eqbJ->eIJqab", weights, slope, slope).reshape(n, 4 * POINTS, 81)
    basis, mass = orthogonal_basis(weights, np.stack([np.ones_like(xi), xi, eta], axis=1))
    pressure = np.einsum("eq,eqaI,eqk->eIqak", weights, slope, basis).reshape(n, 2 * POINTS, 27)
    load = np.einsum("eq,qa->ea", weights, values)
    return Operators(
        gradient, weighted, tangent, pressure, basis, mass, load, np.einsum("eq,eqaI->eaI", weights, slope), weights
    )


def orthogonal_basis(weights: Array, raw: Array) -> tuple[Array, Array]:
    """Make functions on each element orthogonal by the method of Gram and Schmidt."""
    # ``weights`` (E, q): weights of the q Gauss points of E elements. ``raw`` (q, m): values of m functions at these
    # points. The results: values of the orthogonal functions, (E, q, m), and the weighted sums of their squares, (E,
    # m).
    (n, q), m = weights.shape, raw.shape[1]
    basis, mass = np.empty((n, q, m)), np.empty((n, m))
    for k in range(m):
        f = np.broadcast_to(raw[:, k], (n, q)).copy()
        for j in range(k):
            f -= (np.einsum("eq,eq,eq->e", weights, f, basis[..., j]) / mass[:, j])[:, None] * basis[..., j]
        basis[..., k] = f
        mass[:, k] = np.einsum("eq,eq,eq->e", weights, f, f)
    return basis, mass


def mixed(batch: Batch) -> bool:
    """Return whether the pressure is an unknown: True in plane strain, False in plane stress."""
    return batch.section == "plane-strain"


def gradients(ops: Operators, nodal: Array) -> Array:
    """Return the displacement gradient du_i/dX_j at all Gauss points."""
    # ``nodal`` (E, B, 2, 9): displacements in mm, for E elements and B candidate laws. The result is (2, 2, E, B, q).
    n, b = nodal.shape[:2]
    h = np.matmul(nodal.reshape(n, b * 2, 9), ops.gradient)
    return np.ascontiguousarray(h.reshape(n, b, 2, 2, POINTS).transpose(2, 3, 0, 1, 4))


def stretch(ops: Operators, nodal: Array) -> Array:
    """Return the largest principal stretch in the plane at all Gauss points."""
    # ``nodal`` (E, B, 2, 9): displacements in mm. The result is (E, B, q).
    (h11, h12), (h21, h22) = gradients(ops, nodal)
    a = (1 + h11) ** 2 + h12**2 + h21**2 + (1 + h22) ** 2
    J = (1 + h11) * (1 + h22) - h12 * h21
    return np.asarray(np.sqrt(0.5 * (a + np.sqrt(np.maximum(a * a - 4 * J * J, 0.0)))))


class Evaluation(NamedTuple):
    """Forces, stresses and strains of all elements."""

    # E elements with q Gauss points each, for B candidate laws.

    # (E, B, 2, 9): internal forces on the nodes in N/mm.
    force: Array
    # (2, 2, E, B, q): deformation gradient in the plane.
    F: Array
    # (E, B, q): determinant of F.
    J: Array
    # Derivatives of the strain energy psi by F : F and J.
    energy: PlanarEnergy
    # (E, B, q): sum of the pressure and the derivative of psi by J, in MPa.
    t: Array
    # (3, E, B, q): components 11, 22, 12 of the second Piola-Kirchhoff stress in MPa.
    S: Array
    # (B,): whether J exceeds 0.001 at all Gauss points.
    valid: NDArray[np.bool_]


@dataclass(frozen=True)
class Batch:
    """Candidates (sets of parameters of a law) that are solved together."""

    # B candidates.

    # The hyperelastic law.
    law: Law
    # (B, n): the n parameters of each candidate; moduli in MPa.
    parameters: Array
    # How the depth is modelled.
    section: Section | Literal["solid"]
    # (B,): bulk modulus in MPa.
    bulk: Array


SMALLEST_J = 1e-3  # an element with a smaller J at a Gauss point counts as folded


def evaluate(ops: Operators, batch: Batch, nodal: Array, pressure: Array) -> Evaluation:
    """Compute the forces and stresses of all elements."""
    # ``nodal`` (E, B, 2, 9): displacements in mm. ``pressure`` (E, B, 3): coefficients of the pressure functions in
    # MPa.
    F = gradients(ops, nodal)
    F[0, 0] += 1
    F[1, 1] += 1
    (f11, f12), (f21, f22) = F
    a = f11 * f11 + f12 * f12 + f21 * f21 + f22 * f22
    J = f11 * f22 - f12 * f21
    valid = np.isfinite(a).all(axis=(0, 2)) & (J > SMALLEST_J).all(axis=(0, 2))
    if not valid.all():  # keep the arithmetic of failed candidates finite; their status says that they failed
        a = np.where(valid[:, None], a, 2.0)
        J = np.where(valid[:, None], J, 1.0)
    assert batch.section != "solid"
    energy = batch.law.planar(batch.parameters[:, None, :], a, J, batch.section)
    t = energy.J
    if batch.section == "plane-strain":
        t = t + np.matmul(pressure, ops.basis.transpose(0, 2, 1))
    twice = 2 * energy.a
    n, b = nodal.shape[:2]
    P = np.empty((n, b, 2, 2, POINTS))
    P[:, :, 0, 0] = twice * f11 + t * f22
    P[:, :, 0, 1] = twice * f12 - t * f21
    P[:, :, 1, 0] = twice * f21 - t * f12
    P[:, :, 1, 1] = twice * f22 + t * f11
    force = np.matmul(P.reshape(n, b * 2, 2 * POINTS), ops.weighted).reshape(n, b, 2, 9)
    r = t / J
    S = np.stack(
        [
            twice + r * (f12 * f12 + f22 * f22),
            twice + r * (f11 * f11 + f21 * f21),
            -r * (f11 * f12 + f21 * f22),
        ]
    )
    return Evaluation(force, F, J, energy, t, S, valid)


def stiffness(ops: Operators, ev: Evaluation, predicted: Array) -> Array:
    """Return the tangent stiffness of all elements at constant pressure in N/mm²."""
    # ``predicted`` (3, E, B, q): components 11, 22, 12 of the stress for the geometric part in MPa. The result is (E,
    # B, 18, 18).
    (f11, f12), (f21, f22) = ev.F
    e = ev.energy
    n, b = f11.shape[:2]
    aa, aJ, JJ = 4 * e.aa, 2 * e.aJ, e.JJ
    # dP/dF = 2 psi_a 1 + F (x) X + Z (x) Y + t dZ/dF with the cofactors Z, X = aa F + aJ Z, Y = aJ F + JJ Z.
    x11, x12, x21, x22 = aa * f11 + aJ * f22, aa * f12 - aJ * f21, aa * f21 - aJ * f12, aa * f22 + aJ * f11
    y11, y12, y21, y22 = aJ * f11 + JJ * f22, aJ * f12 - JJ * f21, aJ * f21 - JJ * f12, aJ * f22 + JJ * f11
    s11, s22, s12 = predicted - ev.S
    s11 = s11 + 2 * e.a
    s22 = s22 + 2 * e.a
    T = np.empty((n, b, 3, 2, 2, POINTS))  # pairs (i, j) = 11, 12, 22
    T[:, :, 0, 0, 0] = f11 * x11 + f22 * y11 + s11
    T[:, :, 0, 0, 1] = T[:, :, 0, 1, 0] = f11 * x12 + f22 * y12 + s12
    T[:, :, 0, 1, 1] = f12 * x12 - f21 * y12 + s22
    T[:, :, 1, 0, 0] = f11 * x21 + f22 * y21
    T[:, :, 1, 0, 1] = f11 * x22 + f22 * y22 + ev.t
    T[:, :, 1, 1, 0] = f12 * x21 - f21 * y21 - ev.t
    T[:, :, 1, 1, 1] = f12 * x22 - f21 * y22
    T[:, :, 2, 0, 0] = f21 * x21 - f12 * y21 + s11
    T[:, :, 2, 0, 1] = T[:, :, 2, 1, 0] = f21 * x22 - f12 * y22 + s12
    T[:, :, 2, 1, 1] = f22 * x22 + f11 * y22 + s22
    blocks = np.matmul(T.reshape(n, b * 3, 4 * POINTS), ops.tangent).reshape(n, b, 3, 9, 9)
    K = np.empty((n, b, 2, 9, 2, 9))
    K[:, :, 0, :, 0, :] = blocks[:, :, 0]
    K[:, :, 0, :, 1, :] = blocks[:, :, 1]
    K[:, :, 1, :, 0, :] = blocks[:, :, 1].swapaxes(-1, -2)
    K[:, :, 1, :, 1, :] = blocks[:, :, 2]
    return K.reshape(n, b, 18, 18)


def tangents(ops: Operators, ev: Evaluation, predicted: Array) -> Iterator[Array]:
    """Yield one array, the tangent stiffness of all elements with the stress ``predicted`` in its geometric part."""
    yield stiffness(ops, ev, predicted)


def volume_gap(ops: Operators, batch: Batch, ev: Evaluation, pressure: Array) -> Array:
    """Return the residuals of the relation between pressure and volume change."""
    # ``pressure`` (E, B, m): coefficients of m pressure functions in MPa, as the result.
    residual = np.matmul((ev.J - 1) * ops.weights[:, None, :], ops.basis)
    return residual - pressure * ops.mass[:, None, :] / batch.bulk[:, None]


def volume_coupling(ops: Operators, ev: Evaluation) -> Array:
    """Return the derivatives of the elements' volumes with respect to the nodal displacements in mm."""
    # (E, B, 18, 3): the volume per mm of depth is weighted by each of three pressure functions.
    (f11, f12), (f21, f22) = ev.F
    n, b = f11.shape[:2]
    Z = np.empty((n, b, 2, 2, POINTS))
    Z[:, :, 0, 0], Z[:, :, 0, 1], Z[:, :, 1, 0], Z[:, :, 1, 1] = f22, -f21, -f12, f11
    return np.matmul(Z.reshape(n, b * 2, 2 * POINTS), ops.pressure).reshape(n, b, 18, 3)


def predict_stress(ops: Operators, ev: Evaluation, step: Array, pressure_step: Array | None) -> Array:
    """Return the second Piola-Kirchhoff stress in MPa after a Newton step, by linearisation."""
    # ``step`` (E, B, 2, 9): changes of the displacements in mm. ``pressure_step`` (E, B, 3): changes of the pressures
    # in MPa. The result is (3, E, B, q) with the components 11, 22, 12.
    (h11, h12), (h21, h22) = gradients(ops, step)
    (f11, f12), (f21, f22) = ev.F
    e = ev.energy
    da = 2 * (f11 * h11 + f12 * h12 + f21 * h21 + f22 * h22)
    dJ = f22 * h11 - f21 * h12 - f12 * h21 + f11 * h22
    dt = e.aJ * da + e.JJ * dJ
    if pressure_step is not None:
        dt = dt + np.matmul(pressure_step, ops.basis.transpose(0, 2, 1))
    r = ev.t / ev.J
    dr = (dt - r * dJ) / ev.J
    twice = 2 * (e.aa * da + e.aJ * dJ)
    d11, d22 = 2 * (f11 * h11 + f21 * h21), 2 * (f12 * h12 + f22 * h22)
    d12 = f11 * h12 + f12 * h11 + f21 * h22 + f22 * h21
    return ev.S + np.stack(
        [
            twice + dr * (f12 * f12 + f22 * f22) + r * d22,
            twice + dr * (f11 * f11 + f21 * f21) + r * d11,
            -dr * (f11 * f12 + f21 * f22) - r * d12,
        ]
    )
