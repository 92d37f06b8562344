"""Estimate the error of states that were omitted from a fit (cross-validation)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.interval.covariance import LinearStates

Array = NDArray[np.float64]


def held_out_error_mm(experiments: Sequence[LinearStates], hessian: Array, folds: int = 5) -> float | None:
    """Return the mean error that a fit has in states which it did not use, by cross-validation.

    The error of a state is its root mean square residual. The states are divided into folds. Fold f contains the states
    f, f + folds, f + 2 folds and so on. Each fold is omitted in turn (Hastie, Tibshirani and Friedman 2009, The
    Elements of Statistical Learning, section 7.10). Let J_k be the slopes, r_k the residuals and w_k the weights of the
    states k of a fold, and H the Hessian of all states. One Gauss-Newton step for the other states,

        dx = inv(H - sum_k w_k J_k' J_k) sum_k w_k J_k' r_k,

    gives the residuals r_k + J_k dx of the fold.

    Parameters
    ----------
    experiments : sequence of LinearStates
        The states of each experiment, linearised about the optimum.
    hessian : ndarray, shape (n, n)
        Hessian H of all states and priors.
    folds : int
        Number of folds; reduced to the number of states if there are fewer states.

    Returns
    -------
    float or None
        The mean error of the omitted states in mm; None if there is only one state.
    """
    states = [(experiment, k) for experiment in experiments for k in range(len(experiment.weights))]
    if len(states) < 2:
        return None
    folds = min(folds, len(states))
    errors = []
    for fold in range(folds):
        left_out = states[fold::folds]
        normal, score = hessian.copy(), np.zeros(len(hessian))
        for experiment, k in left_out:
            slope = experiment.slopes[:, k]
            normal -= experiment.weights[k] * np.einsum("ign,jgn->ij", slope, slope)
            score += experiment.weights[k] * np.einsum("ign,gn->i", slope, experiment.residuals[k])
        step = np.linalg.solve(normal, score)
        for experiment, k in left_out:
            residual = experiment.residuals[k] + np.einsum("i,ign->gn", step, experiment.slopes[:, k])
            errors.append(float(np.sqrt((residual**2).sum() / max(experiment.counts[k], 1.0))))
    return float(np.mean(errors))
