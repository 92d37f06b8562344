"""Compute the evidence (probability density of the data) of linear models with normal noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ERRORS_MM = np.concatenate([[0.0], np.geomspace(1e-4, 1.0, 17)])  # eta; the evidence is averaged over it


@dataclass(frozen=True)
class Posterior:
    """The evidence (probability density of the data) and the posterior coefficients of several linear models."""

    # There are H models with C coefficients.

    # (H,): logarithm of the evidence of each model.
    log_evidence: Array
    # (H, C): posterior means of the coefficients, in prior standard deviations.
    means: Array
    # (H, C): posterior mean squares of the coefficients, in prior variances.
    squares: Array
    # (H,): posterior mean square of the unexplained error, in mm^2.
    error_squared: Array

    def take(self, rows: slice) -> Posterior:
        """Return the results of some of the linear models."""
        return Posterior(self.log_evidence[rows], self.means[rows], self.squares[rows], self.error_squared[rows])

    @staticmethod
    def of_all(parts: Sequence[Posterior]) -> Posterior:
        """Concatenate the results of several groups of linear models."""
        names = ("log_evidence", "means", "squares", "error_squared")
        return Posterior(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def weigh(columns: Array, members: NDArray[np.intp], y: Array, noise: Array, error: Array) -> Posterior:
    """Compute the evidence (probability density of the data) and the posterior coefficients of linear models."""
    # There are H models, C coefficients, and N data in mm. columns (C, N): change of the data by one prior standard
    # deviation of each coefficient; the last row is zero. members (H, q): indices of the coefficients of each model,
    # filled up with the last index. y (H, N): data for each model. noise (N,): variance of each datum due to noise.
    # error (N,): its variance due to other errors with a standard deviation of 1 mm; the true standard deviation is
    # estimated.
    # Bishop 2006, Pattern Recognition and Machine Learning, section 3.5, with Woodbury's identity.
    common, own = _common(members)
    h, q = members.shape
    logs, means, squares = np.zeros((len(_ERRORS_MM), h)), *np.zeros((2, len(_ERRORS_MM), h, q))
    for i, eta in enumerate(_ERRORS_MM):
        precision = 1 / (noise + eta**2 * error)
        gram, projected = (columns * precision) @ columns.T, (y * precision) @ columns.T
        # The coefficients that all hypotheses have are eliminated first (Schur complement).
        of_common = np.linalg.inv(np.eye(len(common)) + gram[np.ix_(common, common)])
        by_common = of_common @ gram[common]
        reduced = projected - projected[:, common] @ by_common
        system = np.eye(q - len(common)) + (gram - gram[:, common] @ by_common)[own[:, :, None], own[:, None, :]]
        covariance = np.linalg.inv(system)
        of_own = np.take_along_axis(reduced, own, axis=1)
        mean = (covariance @ of_own[..., None])[..., 0]
        moved = by_common[:, own].transpose(1, 0, 2)  # (H, common, own)
        alone = projected[:, common] @ of_common
        means[i] = np.concatenate([alone - (moved @ mean[..., None])[..., 0], mean], axis=1)
        variance = np.diag(of_common) + ((moved @ covariance) * moved).sum(axis=-1)
        squares[i] = np.concatenate([variance, np.diagonal(covariance, axis1=1, axis2=2)], axis=1) + means[i] ** 2
        logs[i] = 0.5 * (np.log(precision).sum() - (y**2 * precision).sum(axis=1))
        logs[i] += 0.5 * ((projected[:, common] * alone).sum(axis=1) + (of_own * mean).sum(axis=1))
        logs[i] += 0.5 * (np.linalg.slogdet(of_common)[1] - np.linalg.slogdet(system)[1])
    largest = logs.max(axis=0)
    weights = np.exp(logs - largest)
    total = weights.sum(axis=0)
    averages = np.zeros((2, h, len(columns)))
    for average, values in zip(averages, (means, squares), strict=True):
        np.put_along_axis(average, members, np.einsum("eh,ehq->hq", weights / total, values), axis=1)
        average[:, -1] = 0.0
    log_evidence, of_means, of_squares = largest + np.log(total / len(_ERRORS_MM)), *averages
    return Posterior(log_evidence, of_means, of_squares, _ERRORS_MM**2 @ (weights / total))


def _common(members: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    # The indices of the coefficients that all models have, and of the other coefficients of each model.
    differs = (members != members[0]).any(axis=0)
    first = int(np.argmax(differs)) if differs.any() else members.shape[1]
    return members[0, :first], members[:, first:]
