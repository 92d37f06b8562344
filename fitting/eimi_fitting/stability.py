"""Drucker's stability: does more strain always take more stress, over the deformations that the specimen reaches?

A law is stable at a deformation when the increments of Kirchhoff stress and logarithmic strain do positive work,
d tau : d eps > 0, for every isochoric increment: the Hessian of the energy in the logarithmic principal stretches,
restricted to increments whose sum is zero, must be positive definite (Drucker 1959, J. Appl. Mech. 26:101).
Checked, as commercial solvers do, along uniaxial, equibiaxial and planar tension and compression.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.materials import Law

Array = NDArray[np.float64]

# Logarithmic principal strains of the three modes per unit of logarithmic stretch; compression is the negative.
_MODES = np.array([[1.0, -0.5, -0.5], [0.5, 0.5, -1.0], [1.0, 0.0, -1.0]])
# Orthonormal basis of the isochoric increments.
_BASIS = np.array([[1.0, -1.0, 0.0], [1.0, 1.0, -2.0]]) / np.sqrt([[2.0], [6.0]])
LARGEST_STRETCH_CHECKED = 6.0


def _smallest_stiffness(law: Law, parameters: Array, log_stretch: Array) -> Array:
    """(P, n) parameters and (P, m) logarithmic stretches -> (P, m): smallest eigenvalue over all modes and signs."""
    signs = np.concatenate([_MODES, -_MODES])
    # A mode is entered by its largest stretch, whichever direction that is.
    signs = signs / signs.max(axis=1, keepdims=True)
    stretches = np.exp(log_stretch[:, :, None, None] * signs)  # (P, m, 6, 3)
    _, _, hessian = law.principal(parameters[:, None, None, :], stretches)
    projected = np.einsum("ai,pmsij,bj->pmsab", _BASIS, hessian, _BASIS)
    return np.asarray(np.linalg.eigvalsh(projected)[..., 0].min(axis=2))


def stable_stretch(law: Law, parameters: Array, reached: Array, steps: int = 25) -> Array:
    """(P, n) and (P,) -> (P,): the largest stretch, up to the one reached, at which a law is stable in every mode."""
    parameters = np.atleast_2d(parameters)
    log_stretch = np.log(np.maximum(reached, 1.0))[:, None] * np.linspace(0, 1, steps)
    with np.errstate(all="ignore"):
        stable = _smallest_stiffness(law, parameters, log_stretch) > 0
    last = np.logical_and.accumulate(stable, axis=1).sum(axis=1) - 1
    return np.where(last < 0, 0.0, np.exp(np.take_along_axis(log_stretch, np.maximum(last, 0)[:, None], axis=1)[:, 0]))


def stable_up_to(law: Law, parameters: Array) -> float | None:
    """Largest stretch (in any mode) up to which one candidate (n,) is stable; None where no limit was met up to 6."""
    log_stretch = np.linspace(0, np.log(LARGEST_STRETCH_CHECKED), 400)
    with np.errstate(all="ignore"):
        positive = _smallest_stiffness(law, np.atleast_2d(parameters), log_stretch[None])[0] > 0
    if positive.all():
        return None
    first = int(np.argmin(positive))
    return float(np.exp(log_stretch[max(first - 1, 0)]))
