"""Estimate how many neighbouring residuals of an edge or a curve count as one independent residual."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def correlation_length(residuals: Array, weights: Array) -> float:
    """Estimate how many neighbouring residuals count as one independent residual, from their autocorrelation.

    Parameters
    ----------
    residuals : array, shape (..., n)
        Residuals in groups of n neighbouring points. The residual of an unused point is zero.
    weights : array, shape (..., n)
        Weight of each residual: above zero for a used point, zero for an unused point.

    Returns
    -------
    float
        The integrated autocorrelation length. It is at least 1, and 1 if all residuals are zero.

    References
    ----------
    C. J. Geyer (1992), Statist. Sci. 7:473, describes a similar rule for the end of the sum of autocorrelations.
    """
    # The length is 1 + 2 sum_k rho_k with the autocorrelation rho_k at the distance of k points: rho_k is the mean of
    # r_i r_(i+k) over all pairs of used points in a group, divided by the mean of r_i^2. The sum ends before the first
    # rho_k that is zero or negative.
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
