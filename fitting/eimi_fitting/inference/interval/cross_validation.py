"""Estimate the error of a fit in load cases that were omitted from it (cross-validation)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.interval.covariance import LinearStates

Array = NDArray[np.float64]


def held_out_error_mm(experiments: Sequence[LinearStates], hessian: Array, folds: int = 5) -> float | None:
    """Return the mean error in mm of a fit in load cases that were omitted from it (cross-validation)."""
    # hessian (n, n): of minus the logarithm of the likelihood times the priors. folds: number of groups of load cases;
    # each group is omitted once.
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
        # Because the residuals are linear, the fit to the other states is one step without a new simulation.
        step = np.linalg.solve(normal, score)
        for experiment, k in left_out:
            residual = experiment.residuals[k] + np.einsum("i,ign->gn", step, experiment.slopes[:, k])
            errors.append(float(np.sqrt((residual**2).sum() / max(experiment.counts[k], 1.0))))
    return float(np.mean(errors))
