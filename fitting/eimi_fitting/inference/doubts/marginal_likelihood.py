"""The evidence of linear Gaussian models that share their data, in closed form; equations in `doubts.causes`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ERRORS_MM = np.concatenate([[0.0], np.geomspace(1e-4, 1.0, 17)])  # eta


@dataclass(frozen=True)
class Posterior:
    """The result of the comparison of hypotheses, with normal priors of all coefficients.

    Parameters
    ----------
    log_evidence : ndarray, shape (H,)
        Logarithm of the evidence of each hypothesis, averaged over eta.
    means : ndarray, shape (H, C)
        Mean of each coefficient, in its prior standard deviations; zero for columns that are not in the hypothesis.
    squares : ndarray, shape (H, C)
        Mean square of each coefficient, in the same units.
    error_squared : ndarray, shape (H,)
        Mean of eta squared in mm^2.
    """

    log_evidence: Array
    means: Array
    squares: Array
    error_squared: Array


def weigh(columns: Array, members: NDArray[np.intp], y: Array, noise: Array, error: Array) -> Posterior:
    """Return the evidence of hypotheses and the means of their coefficients; the module has the equations.

    Parameters
    ----------
    columns : ndarray, shape (C, N)
        The columns A', each times the prior standard deviation of its coefficient; the last one is zero.
    members : ndarray, shape (H, q)
        Columns of each hypothesis; the last column, which is zero, fills unused places.
    y : ndarray, shape (H, N)
        Minus the residuals, for each hypothesis.
    noise, error : ndarray, shape (N,)
        Variance of the noise, and of the unnamed error for eta of 1 mm.
    """
    h, q = members.shape
    logs, means, squares = np.zeros((len(_ERRORS_MM), h)), *np.zeros((2, len(_ERRORS_MM), h, q))
    for i, eta in enumerate(_ERRORS_MM):
        precision = 1 / (noise + eta**2 * error)
        gram = (columns * precision) @ columns.T
        projected = np.take_along_axis((y * precision) @ columns.T, members, axis=1)
        system = np.eye(q) + gram[members[:, :, None], members[:, None, :]]
        covariance = np.linalg.inv(system)
        means[i] = (covariance @ projected[..., None])[..., 0]
        squares[i] = means[i] ** 2 + np.diagonal(covariance, axis1=1, axis2=2)
        logs[i] = 0.5 * (np.log(precision).sum() - (y**2 * precision).sum(axis=1))
        logs[i] += 0.5 * ((projected * means[i]).sum(axis=1) - np.linalg.slogdet(system)[1])
    largest = logs.max(axis=0)
    weights = np.exp(logs - largest)
    total = weights.sum(axis=0)
    averages = np.zeros((2, h, len(columns)))
    for average, values in zip(averages, (means, squares), strict=True):
        np.put_along_axis(average, members, np.einsum("eh,ehq->hq", weights / total, values), axis=1)
        average[:, -1] = 0.0
    log_evidence, of_means, of_squares = largest + np.log(total / len(_ERRORS_MM)), *averages
    return Posterior(log_evidence, of_means, of_squares, _ERRORS_MM**2 @ (weights / total))
