"""Estimate how many neighbouring residuals of an edge or a curve count as one independent residual."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def correlation_length(residuals: Array, weights: Array) -> float:
    """Return the integrated autocorrelation length tau of residuals: tau neighbouring points count as one.

    Parameters
    ----------
    residuals : array, shape (..., n)
        Residuals in groups of n neighbouring points; zero for a point that is not used.
    weights : array, shape (..., n)
        Above zero for a point that is used, else zero.

    Returns
    -------
    float
        tau = 1 + 2 sum_k rho_k >= 1. The autocorrelation rho_k is the mean of r_i r_(i+k) over all pairs of used points
        in a group, divided by the mean of r_i^2, with the residuals r_i. tau is 1 if all residuals are zero.

    References
    ----------
    The sum ends before the first rho_k that is zero or negative. This rule is similar to the initial positive sequence
    of C. J. Geyer (1992), Statist. Sci. 7:473.
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
