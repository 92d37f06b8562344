"""Linear equations for the coefficients of the terms of a hyperelastic law, divided by the noise of the measurement.

    observed = columns @ coefficients + nuisances @ amplitudes + noise

``noise`` has unit variance. A nuisance is an error of an input, such as a width, or a common error of the modulus of
all beams. Its size in standard uncertainties is one of the ``amplitudes``, which have a normal prior with mean 0 and
standard deviation 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Rows:
    """N linear equations for the coefficients of J terms of a law and the amplitudes of q nuisances.

    A nuisance is an error of an input, such as a width; its amplitude is the error in standard uncertainties.

    Parameters
    ----------
    observed : array, shape (N,)
        Left-hand sides, in units of the noise.
    columns : array, shape (N, J)
        Change of each left-hand side for a coefficient of 1 Pa.
    nuisances : array, shape (N, q)
        Change of each left-hand side for a nuisance amplitude of one.
    groups : array of int, shape (N,)
        Group of each equation. Cross-validation omits all equations of a group at the same time.
    """

    observed: Array
    columns: Array
    nuisances: Array
    groups: NDArray[np.intp]

    def with_noise_times(self, factor: float) -> Rows:
        """Divide both sides of each equation by ``factor``, for noise that is ``factor`` times as large."""
        return Rows(self.observed / factor, self.columns / factor, self.nuisances / factor, self.groups)

    def fit_all_terms(self) -> tuple[Array, Array]:
        """Return the non-negative coefficients of all J terms in Pa, (J,), and the q errors of inputs, (q,).

        The errors are in standard uncertainties.
        """
        j, q = self.columns.shape[1], self.nuisances.shape[1]
        prior = np.hstack([np.zeros((q, j)), np.eye(q), -np.eye(q)])
        columns = np.vstack([np.hstack([self.columns, self.nuisances, -self.nuisances]), prior])
        solution = non_negative(columns, np.append(self.observed, np.zeros(q)))
        return solution[:j], solution[j : j + q] - solution[j + q :]

    @staticmethod
    def joined(parts: Sequence[Rows]) -> Rows:
        """Join the equations of all ``parts``; column i of ``nuisances`` belongs to the same unknown in every part."""
        width = max(part.nuisances.shape[1] for part in parts)
        counts = np.cumsum([0, *(int(part.groups.max(initial=-1)) + 1 for part in parts)])
        return Rows(
            np.concatenate([part.observed for part in parts]),
            np.concatenate([part.columns for part in parts]),
            np.concatenate([np.pad(p.nuisances, ((0, 0), (0, width - p.nuisances.shape[1]))) for p in parts]),
            np.concatenate([part.groups + before for part, before in zip(parts, counts[:-1], strict=True)]),
        )


def non_negative(columns: Array, observed: Array) -> Array:
    """Return the J non-negative coefficients x that minimise |columns x - observed|^2, shape (J,).

    ``columns`` has the shape (N, J) and ``observed`` the shape (N,).

    References
    ----------
    C. L. Lawson, R. J. Hanson (1974), Solving Least Squares Problems, chapter 23.
    """
    size = np.linalg.norm(columns, axis=0)
    size = np.where(size > 0, size, 1.0)
    return np.asarray(scipy.optimize.nnls(columns / size, observed)[0] / size)
