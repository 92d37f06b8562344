"""Test whether residuals along edges look like independent noise about zero.

For such noise, a residual is positive with a probability of one half and is not correlated with the next residual.

References
----------
A. Wald and J. Wolfowitz (1940), Ann. Math. Statist. 11:147, for runs of one sign; R. L. Anderson (1942), Ann. Math.
Statist. 13:1, for the serial correlation; J. von Neumann (1941), Ann. Math. Statist. 12:367, for the noise from
successive differences.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SIGNIFICANT = 0.01  # residuals with a smaller probability do not count as noise
_FEWEST = 10  # smallest number of pairs of neighbours for a verdict


@dataclass(frozen=True)
class Randomness:
    """The results of two tests for randomness of residuals along edges: sign changes and serial correlation."""

    # Number n of pairs of neighbouring points.
    pairs: int
    # Number of pairs whose two residuals have different signs. n / 2 is expected for independent noise.
    sign_changes: int
    # Probability that independent noise has at most ``sign_changes`` sign changes.
    runs_probability: float
    # Mean product of two neighbouring residuals, divided by the mean square of all residuals. 0 is expected for
    # independent noise.
    autocorrelation: float
    # Probability that independent noise has at least the autocorrelation ``autocorrelation``.
    autocorrelation_probability: float
    # Standard deviation s of the part of the residuals that is independent from point to point, in their unit. s^2 is
    # half of the mean square difference of neighbouring residuals.
    noise: float
    # Root mean square of the part of the residuals that neighbouring points share, in their unit.
    systematic: float

    @property
    def decided(self) -> bool:
        """Whether there are at least 10 pairs of neighbouring residuals, enough to test for randomness."""
        return self.pairs >= _FEWEST

    @property
    def is_noise(self) -> bool:
        """Whether the residuals may be independent noise."""
        # Both probabilities are at least 1 %.
        return min(self.runs_probability, self.autocorrelation_probability) >= _SIGNIFICANT


def randomness_of(residuals: Array) -> Randomness:
    """Test whether residuals are independent noise about zero, by sign changes and by serial correlation.

    Parameters
    ----------
    residuals : ndarray, shape (..., m)
        Residuals in groups of m neighbouring points; NaN for a point that was not measured.

    Returns
    -------
    Randomness
        The results of both tests. Both probabilities are 1 if there is no pair of points or if all residuals are zero.

    Examples
    --------
    >>> noise = np.random.default_rng(0).normal(0, 0.4, (12, 90))
    >>> randomness_of(noise).is_noise
    True
    >>> bowed = noise + np.sin(np.linspace(0, np.pi, 90))
    >>> randomness_of(bowed).is_noise
    False
    >>> f"{randomness_of(bowed).noise:.1f}, {randomness_of(bowed).systematic:.1f}"
    '0.4, 0.7'
    """
    groups = residuals.reshape(-1, residuals.shape[-1])
    rows = [row[np.isfinite(row)] for row in groups]
    first = np.concatenate([np.zeros(0), *(row[:-1] for row in rows)])
    second = np.concatenate([np.zeros(0), *(row[1:] for row in rows)])
    pairs = len(first)
    square = float(np.mean(np.concatenate([np.zeros(0), *rows]) ** 2)) if any(len(row) for row in rows) else 0.0
    if not pairs or square == 0.0:
        return Randomness(pairs, 0, 1.0, 0.0, 1.0, 0.0, 0.0)
    changes = int((first * second < 0).sum())
    correlation = float((first * second).mean()) / square
    noise = 0.5 * float(((second - first) ** 2).mean())
    return Randomness(
        pairs=pairs,
        sign_changes=changes,
        runs_probability=float(scipy.special.bdtr(changes, pairs, 0.5)),
        autocorrelation=correlation,
        autocorrelation_probability=float(scipy.special.ndtr(-correlation * np.sqrt(pairs))),
        noise=float(np.sqrt(min(noise, square))),
        systematic=float(np.sqrt(max(square - noise, 0.0))),
    )
