"""Compute the evidence (probability density of the data) of linear Gaussian models of the same data.

The equations are in `inference.doubts.causes`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ERRORS_MM = np.concatenate([[0.0], np.geomspace(1e-4, 1.0, 17)])  # eta


@dataclass(frozen=True)
class Posterior:
    """The evidence of H linear Gaussian models (hypotheses), and the posterior of C coefficients in each hypothesis.

    Parameters
    ----------
    log_evidence : ndarray, shape (H,)
        Logarithm of the evidence (probability density of the data) of each hypothesis. The evidence is averaged over
        the size eta in mm of an error that no hypothesis explains.
    means : ndarray, shape (H, C)
        Posterior mean of each coefficient, divided by the prior standard deviation of the coefficient. Zero for a
        coefficient that the hypothesis does not have.
    squares : ndarray, shape (H, C)
        Posterior mean of the square of each coefficient, divided by the prior variance of the coefficient.
    error_squared : ndarray, shape (H,)
        Posterior mean of eta^2 in mm^2.
    """

    log_evidence: Array
    means: Array
    squares: Array
    error_squared: Array


def weigh(columns: Array, members: NDArray[np.intp], y: Array, noise: Array, error: Array) -> Posterior:
    """Return the evidence of H hypotheses and the posterior means of their coefficients.

    A hypothesis is a linear Gaussian model: the N data are a sum of some rows of ``columns``, each times an unknown
    standard normal number, plus noise and an unexplained error. Its evidence is the probability density of the data
    under the model.

    Parameters
    ----------
    columns : ndarray, shape (C, N)
        One row for each coefficient: the change of the N data by the coefficient, times the prior standard deviation of
        the coefficient. The last row is zero.
    members : ndarray, shape (H, q)
        Indices of the rows of ``columns`` that belong to each hypothesis. A hypothesis with fewer than q columns is
        filled up with the index of the last row.
    y : ndarray, shape (H, N)
        The N data that each hypothesis explains: minus the residuals.
    noise, error : ndarray, shape (N,)
        Variance of each datum: due to noise (``noise``), and due to an unexplained error of the size eta = 1 mm
        (``error``).

    Returns
    -------
    Posterior
        Evidence and coefficients of the H hypotheses.
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
