"""Estimate how many neighbouring residuals of an edge or a curve count as one independent residual."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def correlation_length(residuals: Array, weights: Array) -> float:
    """Return the integrated autocorrelation length tau of residuals, in points.

    Parameters
    ----------
    residuals : array, shape (..., n)
        Residuals in groups of n neighbouring points; zero where a point is not used.
    weights : array, shape (..., n)
        A positive weight marks a point that is used.

    Returns
    -------
    float
        tau = 1 + 2 sum_k rho_k >= 1, with rho_k the autocorrelation at a distance of k points.

    References
    ----------
    The sum ends at the first rho_k that is not positive, after the initial positive sequence of C. J. Geyer (1992),
    Statist. Sci. 7:473.
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
