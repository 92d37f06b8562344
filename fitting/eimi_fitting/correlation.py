"""How many of the neighbouring residuals of an edge or a curve count as one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def correlation_length(residuals: Array, weights: Array) -> float:
    """Integrated autocorrelation length tau >= 1 (in points) of groups (..., n) of residuals, zero where unused.

    Summed up to the first negative value (initial positive sequence; Geyer 1992, Statist. Sci. 7:473).
    """
    r = residuals.reshape(-1, residuals.shape[-1])
    w = (weights > 0).astype(float).reshape(r.shape)
    variance = (r**2).sum() / max(w.sum(), 1.0)
    if variance == 0.0:
        return 1.0
    tau = 1.0
    for lag in range(1, r.shape[-1]):
        pairs = (w[:, lag:] * w[:, :-lag]).sum()
        if pairs == 0:
            break
        rho = (r[:, lag:] * r[:, :-lag]).sum() / pairs / variance
        if rho <= 0:
            break
        tau += 2 * rho
    return float(tau)
