"""Linear equations for the coefficients of the terms of a hyperelastic law."""

#     observed = columns @ coefficients + nuisances @ amplitudes + noise
#
# ``noise`` has unit variance. ``amplitudes`` are errors of inputs, such as a width, divided by their standard
# uncertainties, with a standard normal prior. ``nuisances`` are the effects of these errors.

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Rows:
    """Linear equations for the coefficients of a law and for errors of inputs, such as a width."""

    # N equations for J coefficients and q errors of inputs (nuisances).

    # (N,): measured values, in units of the noise.
    observed: Array
    # (N, J): change of each value for a coefficient of 1 Pa.
    columns: Array
    # (N, q): change of each value for an input error of one standard uncertainty.
    nuisances: Array
    # (N,): group of each equation; cross-validation leaves out whole groups.
    groups: NDArray[np.intp]

    def with_noise_times(self, factor: float) -> Rows:
        """Divide all equations by ``factor``, for noise that is ``factor`` times as large."""
        return Rows(self.observed / factor, self.columns / factor, self.nuisances / factor, self.groups)

    def fit_all_terms(self) -> tuple[Array, Array]:
        """Fit the coefficients of all terms (Pa, not negative) and the input errors (in standard uncertainties)."""
        j, q = self.columns.shape[1], self.nuisances.shape[1]
        prior = np.hstack([np.zeros((q, j)), np.eye(q), -np.eye(q)])
        columns = np.vstack([np.hstack([self.columns, self.nuisances, -self.nuisances]), prior])
        solution = non_negative(columns, np.append(self.observed, np.zeros(q)))
        return solution[:j], solution[j : j + q] - solution[j + q :]

    @staticmethod
    def joined(parts: Sequence[Rows]) -> Rows:
        """Join several groups of equations with the same unknowns."""
        width = max(part.nuisances.shape[1] for part in parts)
        counts = np.cumsum([0, *(int(part.groups.max(initial=-1)) + 1 for part in parts)])
        return Rows(
            np.concatenate([part.observed for part in parts]),
            np.concatenate([part.columns for part in parts]),
            np.concatenate([np.pad(p.nuisances, ((0, 0), (0, width - p.nuisances.shape[1]))) for p in parts]),
            np.concatenate([part.groups + before for part, before in zip(parts, counts[:-1], strict=True)]),
        )


def non_negative(columns: Array, observed: Array) -> Array:
    """Find the non-negative vector x that minimises |columns x - observed|^2.

    References
    ----------
    C. L. Lawson, R. J. Hanson (1974), Solving Least Squares Problems, chapter 23.
    """
    size = np.linalg.norm(columns, axis=0)
    size = np.where(size > 0, size, 1.0)
    return np.asarray(scipy.optimize.nnls(columns / size, observed)[0] / size)
