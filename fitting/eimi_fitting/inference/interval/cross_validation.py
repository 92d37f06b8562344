"""Estimate the error of a fit in load cases that were omitted from it (cross-validation)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.interval.covariance import LinearStates

Array = NDArray[np.float64]


def held_out_error_mm(experiments: Sequence[LinearStates], hessian: Array, folds: int = 5) -> float | None:
    """Return the mean error of a fit in load cases that were omitted from it (cross-validation).

    The load cases are divided into groups, and each group is omitted once. Because the residuals are linear, the fit to
    the remaining load cases needs no new simulation.

    Parameters
    ----------
    experiments : sequence of LinearStates
        The residuals of each experiment as linear functions of the n unknowns.
    hessian : ndarray, shape (n, n)
        Hessian of minus the logarithm of the likelihood times the priors.
    folds : int
        Number of groups.

    Returns
    -------
    float or None
        Mean root mean square residual of the omitted load cases in mm; None if there is only one load case.
    """
    states = [(experiment, k) for experiment in experiments for k in range(len(experiment.weights))]
    if len(states) < 2:
        return None
    # Hastie, Tibshirani and Friedman 2009, The Elements of Statistical Learning, section 7.10.
    folds = min(folds, len(states))
    errors = []
    for fold in range(folds):
        left_out = states[fold::folds]
        normal, score = hessian.copy(), np.zeros(len(hessian))
        for experiment, k in left_out:
            slope = experiment.slopes[:, k]
            normal -= experiment.weights[k] * np.einsum("ign,jgn->ij", slope, slope)
            score += experiment.weights[k] * np.einsum("ign,gn->i", slope, experiment.residuals[k])
        # one Gauss-Newton step for the other states
        step = np.linalg.solve(normal, score)
        for experiment, k in left_out:
            residual = experiment.residuals[k] + np.einsum("i,ign->gn", step, experiment.slopes[:, k])
            errors.append(float(np.sqrt((residual**2).sum() / max(experiment.counts[k], 1.0))))
    return float(np.mean(errors))
