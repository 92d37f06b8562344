"""Compute the minimum of a quadratic function in the unit cube."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]


def step_to_minimum(unit: Array, gradient: Array, hessian: Array) -> Array:
    """Return the step from a point in the unit cube to the minimum of a quadratic function in this cube.

    The step d minimises g' d + d' H d / 2, where g is the gradient of the function at the point and H its Hessian.

    Parameters
    ----------
    unit : ndarray, shape (n,)
        The point, with n coordinates from 0 to 1.
    gradient : ndarray, shape (n,)
        The gradient g.
    hessian : ndarray, shape (n, n)
        The Hessian H, positive definite.

    Returns
    -------
    ndarray, shape (n,)
        The step d.
    """
    free = np.asarray(-np.linalg.solve(hessian, gradient), dtype=np.float64)
    if (unit + free >= 0.0).all() and (unit + free <= 1.0).all():
        return free
    factor = np.linalg.cholesky(hessian)
    bounded = scipy.optimize.lsq_linear(
        factor.T, -np.linalg.solve(factor, gradient), (-unit, 1.0 - unit), method="bvls"
    )
    return np.asarray(bounded.x)
