"""Evidence that is linear in the coefficients of a library's terms, in units of its own noise.

    seen = columns @ coefficients + nuisances @ sizes + noise

with noise of unit variance, and sizes that are known to be 0 +- 1. What the noise is, all terms of the library together
say: it is what they leave of a curve or a beam. Residuals that hang together count as fewer
(`eimi_fitting.correlation`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Rows:
    """seen: (N,); columns: (N, J), one a term; nuisances: (N, q); together: (N,) rows of one number are left out at
    once.
    """

    seen: Array
    columns: Array
    nuisances: Array
    together: NDArray[np.intp]

    def noisier(self, factor: float) -> Rows:
        """The same with so much more noise, which is the unit."""
        return Rows(self.seen / factor, self.columns / factor, self.nuisances / factor, self.together)

    def of_all_terms(self) -> tuple[Array, Array]:
        """Coefficients (J,), none below zero, and sizes (q,) of the nuisances that leave least."""
        q = self.nuisances.shape[1]
        known = np.zeros((q, self.columns.shape[1]))
        columns = np.vstack([np.hstack([self.columns, self.nuisances, -self.nuisances]), np.hstack([known, *_both(q)])])
        found = non_negative(columns, np.append(self.seen, np.zeros(q)))
        j = self.columns.shape[1]
        return found[:j], found[j : j + q] - found[j + q :]

    @staticmethod
    def joined(parts: Sequence[Rows]) -> Rows:
        """The rows of all. Nuisances are the same in all; a part without them has zeros."""
        width = max(part.nuisances.shape[1] for part in parts)
        counts = np.cumsum([0, *(int(part.together.max(initial=-1)) + 1 for part in parts)])
        return Rows(
            np.concatenate([part.seen for part in parts]),
            np.concatenate([part.columns for part in parts]),
            np.concatenate([np.pad(p.nuisances, ((0, 0), (0, width - p.nuisances.shape[1]))) for p in parts]),
            np.concatenate([part.together + before for part, before in zip(parts, counts[:-1], strict=True)]),
        )


def _both(count: int) -> tuple[Array, Array]:
    return np.eye(count), -np.eye(count)


def non_negative(columns: Array, seen: Array) -> Array:
    """Least squares (J,) with no coefficient below zero, whatever the columns' sizes (Lawson and Hanson 1974)."""
    size = np.linalg.norm(columns, axis=0)
    size = np.where(size > 0, size, 1.0)
    return np.asarray(optimize.nnls(columns / size, seen)[0] / size)
