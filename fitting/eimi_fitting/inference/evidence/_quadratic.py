"""Compute the minimum of a quadratic function in the unit cube."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]


def step_to_minimum(unit: Array, gradient: Array, hessian: Array) -> Array:
    """Return the step from a point to the minimum of a quadratic function in the unit cube."""
    # The step d minimises g' d + d' H d / 2 for the gradient g and the Hessian H at the point `unit`.
    free = np.asarray(-np.linalg.solve(hessian, gradient), dtype=np.float64)
    if (unit + free >= 0.0).all() and (unit + free <= 1.0).all():
        return free
    factor = np.linalg.cholesky(hessian)
    bounded = scipy.optimize.lsq_linear(
        factor.T, -np.linalg.solve(factor, gradient), (-unit, 1.0 - unit), method="bvls"
    )
    return np.asarray(bounded.x)
