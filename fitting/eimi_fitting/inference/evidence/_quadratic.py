"""The least value of a quadratic within the unit cube."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def step_to_minimum(unit: Array, gradient: Array, hessian: Array) -> Array:
    """The step (n,) from ``unit`` (n,) to where gradient . step + step . hessian . step / 2 is least within 0..1.

    hessian: (n, n), positive definite. Bounded-variable least squares (Stark and Parker 1995, Comput. Statist.
    10:129).
    """
    free = np.asarray(-np.linalg.solve(hessian, gradient), dtype=np.float64)
    if (unit + free >= 0.0).all() and (unit + free <= 1.0).all():
        return free
    from scipy import optimize  # slow to load, and most steps stay inside

    factor = np.linalg.cholesky(hessian)
    found = optimize.lsq_linear(factor.T, -np.linalg.solve(factor, gradient), (-unit, 1.0 - unit), method="bvls")
    return np.asarray(found.x)
