"""Test whether residuals along edges look like independent noise about zero.

Under that hypothesis a residual has either sign with a probability of one half, and no correlation with the next
residual.

References
----------
A. Wald and J. Wolfowitz (1940), Ann. Math. Statist. 11:147, for runs of one sign; R. L. Anderson (1942), Ann. Math.
Statist. 13:1, for the serial correlation; J. von Neumann (1941), Ann. Math. Statist. 12:367, for the noise from
successive differences.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom, norm

Array = NDArray[np.float64]

_SIGNIFICANT = 0.01  # residuals with a smaller probability do not count as noise
_FEWEST = 10  # smallest number of pairs of neighbours for a verdict


@dataclass(frozen=True)
class Randomness:
    """The tests of residuals for randomness along their edges.

    Attributes
    ----------
    pairs : int
        Pairs of neighbouring points.
    sign_changes : int
        Pairs whose two residuals have different signs; noise has half of the pairs.
    runs_probability : float
        Probability of at most this many sign changes if the residuals are noise.
    autocorrelation : float
        Correlation of neighbouring residuals about zero; 0 for noise.
    autocorrelation_probability : float
        Probability of at least this correlation if the residuals are noise.
    noise : float
        Standard deviation of the part that is independent from point to point, in the unit of the residuals.
    systematic : float
        Root mean square of the part that neighbouring points share, in the unit of the residuals.
    """

    pairs: int
    sign_changes: int
    runs_probability: float
    autocorrelation: float
    autocorrelation_probability: float
    noise: float
    systematic: float

    @property
    def decided(self) -> bool:
        """Return whether there are enough points for a verdict."""
        return self.pairs >= _FEWEST

    @property
    def is_noise(self) -> bool:
        """Return whether neither test rejects noise at the level of 1 %."""
        return min(self.runs_probability, self.autocorrelation_probability) >= _SIGNIFICANT


def randomness_of(residuals: Array) -> Randomness:
    """Test residuals for randomness.

    Parameters
    ----------
    residuals : ndarray, shape (..., m)
        Groups of m neighbouring points; NaN where nothing was measured. Points of different groups are not neighbours.

    Returns
    -------
    Randomness

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
        runs_probability=float(binom.cdf(changes, pairs, 0.5)),
        autocorrelation=correlation,
        autocorrelation_probability=float(norm.sf(correlation * np.sqrt(pairs))),
        noise=float(np.sqrt(min(noise, square))),
        systematic=float(np.sqrt(max(square - noise, 0.0))),
    )
