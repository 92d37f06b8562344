"""Stress and tangent of an isotropic hyperelastic law in three dimensions, at many points."""

# The first axis of a symmetric tensor has the components 11, 22, 33, 12, 23, 13. The energy is differentiated by the
# invariants I1 and I2 if the law allows it (Holzapfel, Nonlinear Solid Mechanics, 2000, sections 6.4 and 6.6), and by
# the principal stretches otherwise (Ogden, Non-linear Elastic Deformations, 1997, section 6.1.4).

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.laws.law import Law

Array = NDArray[np.float64]

PLACE = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2]])
"""The index of the component (row, column) of a symmetric tensor among its six components, shape (3, 3)."""

_FIRST, _SECOND = (0, 1, 2, 0, 1, 0), (0, 1, 2, 1, 2, 2)
# Two stretches are taken as equal if their logarithms differ by less than this number. The error of the limiting value
# is proportional to the square of the difference. The rounding error of the quotient is inversely proportional to it.
_EQUAL = 1e-5


@runtime_checkable
class InvariantLaw(Protocol):
    """A law that gives the derivatives of its strain energy by the invariants I1 and I2."""

    def coefficients(self, parameters: Array, x: Array, y: Array) -> tuple[Array, Array, Array, Array]:
        """Return the strain energy W, dW/dx, dW/dy and d²W/dx² at x = I1 - 3 and y = I2 - 3."""


def turned(F: Array, tensor: Array) -> Array:
    """Return the matrix product of F and a symmetric tensor, which is given by its six components."""
    # (3, 3, ...) and (6, ...) give (3, 3, ...).
    return np.asarray(sum(F[:, k, None] * tensor[PLACE[k]] for k in range(3)))


def right_cauchy_green(F: Array) -> Array:
    """Return the six components of C = F^T F for the deformation gradient F."""
    return np.stack([(F[:, _FIRST[v]] * F[:, _SECOND[v]]).sum(axis=0) for v in range(6)])


def _outer(a: Array, b: Array) -> Array:
    return a[:, None] * b[None]


def _inverse_product(B: Array) -> Array:
    """Return the matrix of the linear map from a symmetric tensor dE to B dE B."""
    # ``B`` (6, ...) gives (6, 6, ...).
    # The columns belong to dE11, dE22, dE33, 2 dE12, 2 dE23 and 2 dE13.
    result = np.empty((6, 6, *B.shape[1:]))
    for v in range(6):
        K, L = _FIRST[v], _SECOND[v]
        for w in range(v, 6):
            M, N = _FIRST[w], _SECOND[w]
            product = B[PLACE[K, M]] * B[PLACE[L, N]]
            result[v, w] = product if K == L or M == N else 0.5 * (product + B[PLACE[K, N]] * B[PLACE[L, M]])
            result[w, v] = result[v, w]
    return result


def response(law: Law, parameters: Array, F: Array, J: Array) -> tuple[Array, Array, Array]:
    """Return the isochoric stress S, its derivative by the Green strain, and J C^-1."""
    # ``parameters`` (..., n): for each point or for all points. ``F`` (3, 3, ...): deformation gradient. ``J`` (...):
    # determinant of F. The results are (6, ...), (6, 6, ...) and (6, ...).
    C = right_cauchy_green(F)
    inverse = _adjugate(C) / (J * J)
    if isinstance(law, InvariantLaw):
        S, D = _by_invariants(law, parameters, C, inverse, J)
    else:
        S, D = _by_principal_stretches(law, parameters, C, inverse, J)
    return S, D, J * inverse


def _adjugate(C: Array) -> Array:
    a, b, c, d, e, f = C  # 11, 22, 33, 12, 23, 13
    return np.stack([b * c - e * e, a * c - f * f, a * b - d * d, e * f - c * d, d * f - a * e, d * e - b * f])


def add_pressure(pressure: Array, volume: Array, J: Array, S: Array, D: Array) -> None:
    """Add the contribution of a pressure to the stress S and to its derivative D, in place."""
    # ``volume`` (6, ...): derivative of S by the pressure. ``J``: volume ratio. ``S`` is (6, ...), ``D`` is (6, 6,
    # ...).
    S += pressure * volume
    D += (pressure / J) * (_outer(volume, volume) - 2 * _inverse_product(volume))


def _by_invariants(law: InvariantLaw, parameters: Array, C: Array, inverse: Array, J: Array) -> tuple[Array, Array]:
    unit = np.zeros((6, *(1,) * J.ndim))
    unit[:3] = 1
    scale = J ** (-2 / 3)
    trace = C[0] + C[1] + C[2]
    i1 = scale * trace
    i2 = scale**2 * J**2 * (inverse[0] + inverse[1] + inverse[2])
    _, w1, w2, w11 = law.coefficients(parameters, i1 - 3, i2 - 3)
    first = scale * unit - (i1 / 3) * inverse  # dI1/dC
    S = 2 * w1 * first
    mixed = -(w1 / 3) * first
    spherical, product = -w1 * i1 / 9, w1 * i1 / 3
    of_second: Array | float = 0.0
    if np.any(w2):
        second = scale**2 * (trace * unit - C) - (2 / 3 * i2) * inverse  # dI2/dC
        S += 2 * w2 * second
        mixed -= (2 / 3 * w2) * second
        spherical, product = spherical - 4 / 9 * w2 * i2, product + 2 / 3 * w2 * i2
        identity = np.diag([1, 1, 1, 0.5, 0.5, 0.5]).reshape(6, 6, *(1,) * J.ndim)
        of_second = w2 * scale**2 * (_outer(unit, unit) - identity)
    cross = _outer(mixed + 0.5 * spherical * inverse, inverse)
    D = cross + cross.swapaxes(0, 1) + product * _inverse_product(inverse) + of_second
    if np.any(w11):
        D += w11 * _outer(first, first)
    return S, 4 * D


def _by_principal_stretches(law: Law, parameters: Array, C: Array, inverse: Array, J: Array) -> tuple[Array, Array]:
    squares, vectors = np.linalg.eigh(np.moveaxis(C[PLACE], (0, 1), (-2, -1)))
    _, gradient, hessian = law.principal(parameters, np.sqrt(squares) * J[..., None] ** (-1 / 3))
    tau = gradient - gradient.mean(axis=-1, keepdims=True)  # principal Kirchhoff stresses
    hessian = hessian - hessian.mean(axis=-1, keepdims=True)
    slope = hessian - hessian.mean(axis=-2, keepdims=True)  # d tau_a / d ln lambda_b
    stress = tau / squares
    derivative = (slope - 2 * tau[..., None] * np.eye(3)) / (squares[..., :, None] * squares[..., None, :])  # dS_a/dE_b
    a, b = np.array([0, 1, 0]), np.array([1, 2, 2])
    apart = np.log(squares[..., b] / squares[..., a])
    equal = np.abs(apart) < 2 * _EQUAL
    # If two stretches are equal, the quotient is 0/0 and is replaced by its limit.
    quotient = 2 * (stress[..., b] - stress[..., a]) / np.where(equal, 1.0, squares[..., b] - squares[..., a])
    limit = 0.5 * (derivative[..., a, a] + derivative[..., b, b]) - 0.5 * (
        derivative[..., a, b] + derivative[..., b, a]
    )
    shear = np.where(equal, limit, quotient)
    # Columns: N_a N_a, then twice the symmetric part of N_a N_b, all as strains that the six components multiply.
    K, L = np.array(_FIRST), np.array(_SECOND)
    frame = np.empty((*J.shape, 6, 6))
    frame[..., :3] = vectors[..., K, :] * vectors[..., L, :]
    frame[..., 3:] = vectors[..., K[:, None], a] * vectors[..., L[:, None], b]
    frame[..., 3:] += vectors[..., K[:, None], b] * vectors[..., L[:, None], a]
    inner = np.zeros((*J.shape, 6, 6))
    inner[..., :3, :3] = derivative
    inner[..., [3, 4, 5], [3, 4, 5]] = 0.5 * shear
    D = frame @ inner @ frame.swapaxes(-1, -2)
    S = (frame[..., :3] @ stress[..., None])[..., 0]
    return np.moveaxis(S, -1, 0), np.moveaxis(D, (-2, -1), (0, 1)).copy()
