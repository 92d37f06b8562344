"""The unknowns of a law of time: the modulus, and the terms of its Prony series.

A candidate has the unknowns (ln mu_inf, ln h_1 .. ln h_n, ln tau_1 .. ln tau_n) with mu_i = h_i mu_inf. The prior of
the times is centred on times that divide the range of the data evenly in the logarithm, and extends to the neighbouring
times. A fixed time has practically no uncertainty. The prior of h_i covers losses from 0.2 % to 400 % of the modulus.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.laws.prony import Prony

Array = NDArray[np.float64]

_SHARE = 0.1  # median of the prior of h
_SHARE_SIGMA = 1.5  # prior standard deviation of ln h
_HELD_SIGMA = 1e-6  # prior standard deviation of ln tau for a fixed time
MODULUS_SIGMA = 3.0
"""Prior standard deviation of ln mu_inf, so large that the prior has no influence."""


@dataclass(frozen=True)
class Terms:
    """The unknowns of a law of time with n terms.

    Attributes
    ----------
    count : int
        Number n of terms.
    range_s : tuple of float
        Range of the relaxation times.
    modulus_Pa : float
        Middle of the prior of the modulus.
    free_times : bool
        Whether the relaxation times are unknown.
    """

    count: int
    range_s: tuple[float, float]
    modulus_Pa: float
    free_times: bool = True

    @property
    def mean(self) -> Array:
        """The means of the prior, (1 + 2 n,)."""
        low, high = np.log(self.range_s)
        middle = low + (high - low) * (np.arange(self.count) + 0.5) / self.count
        return np.concatenate([[np.log(self.modulus_Pa)], np.full(self.count, np.log(_SHARE)), middle])

    @property
    def sigma(self) -> Array:
        """The standard deviations of the prior, (1 + 2 n,)."""
        low, high = np.log(self.range_s)
        spacing = (high - low) / (2 * self.count) if self.free_times else _HELD_SIGMA
        return np.concatenate([[MODULUS_SIGMA], np.full(self.count, _SHARE_SIGMA), np.full(self.count, spacing)])

    def split(self, unknowns: Array) -> tuple[Array, Prony]:
        """Return the instantaneous moduli (P,) in Pa and the Prony series of candidates (P, 1 + 2 n)."""
        n = self.count
        long_term = np.exp(unknowns[:, 0])
        h = np.exp(np.clip(unknowns[:, 1 : 1 + n], -30, 10))
        whole = 1 + h.sum(axis=1)
        return long_term * whole, Prony(h / whole[:, None], np.exp(unknowns[:, 1 + n : 1 + 2 * n]))
