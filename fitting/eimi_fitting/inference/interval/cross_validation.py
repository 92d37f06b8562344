"""The error of states that a fit has not seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.interval.covariance import LinearStates

Array = NDArray[np.float64]


def held_out_error_mm(every: Sequence[LinearStates], hessian: Array, folds: int = 5) -> float | None:
    """Mean error of states left out of the fit; None where there is one state alone.

    Every so-many-th state is left out in turn (Hastie, Tibshirani, Friedman 2009, The Elements of Statistical Learning,
    section 7.10), the rest fitted by one Gauss-Newton step, the errors taken from the same linearisation; hessian: (n,
    n) of all states and priors.
    """
    states = [(own, k) for own in every for k in range(len(own.weights))]
    if len(states) < 2:
        return None
    folds = min(folds, len(states))
    errors = []
    for fold in range(folds):
        left_out = states[fold::folds]
        normal, score = hessian.copy(), np.zeros(len(hessian))
        for own, k in left_out:
            slope = own.slopes[:, k]
            normal -= own.weights[k] * np.einsum("ign,jgn->ij", slope, slope)
            score += own.weights[k] * np.einsum("ign,gn->i", slope, own.residuals[k])
        step = np.linalg.solve(normal, score)
        for own, k in left_out:
            residual = own.residuals[k] + np.einsum("i,ign->gn", step, own.slopes[:, k])
            errors.append(float(np.sqrt((residual**2).sum() / max(own.counts[k], 1.0))))
    return float(np.mean(errors))
