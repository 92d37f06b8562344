"""Minimise a quadratic function within the unit cube."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]


def step_to_minimum(unit: Array, gradient: Array, hessian: Array) -> Array:
    """Return the step from a point to the minimum of a quadratic function within the unit cube.

    The step d minimises g' d + d' H d / 2 with the gradient g and the Hessian H. All coordinates of the point plus d
    are within 0..1. The step is computed by bounded-variable least squares (Stark and Parker 1995, Comput.
    Statist. 10:129).

    Parameters
    ----------
    unit : ndarray, shape (n,)
        The point, in unit coordinates from 0 to 1.
    gradient : ndarray, shape (n,)
        The gradient g at the point.
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
