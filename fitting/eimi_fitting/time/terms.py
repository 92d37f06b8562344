"""The unknowns of a viscoelastic (Prony) law: the shear modulus and the terms of the Prony series."""

# With n terms, the unknowns are (ln mu_inf, ln h_1 .. ln h_n, ln tau_1 .. ln tau_n), with the long-term shear modulus
# mu_inf, the modulus h_i mu_inf of each term, and the relaxation times tau_i. All priors are normal.

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
"""Prior standard deviation of the logarithm of the long-term modulus, so large that the prior has no influence."""


@dataclass(frozen=True)
class Terms:
    """The unknowns of a viscoelastic law with a given number of terms, and their prior."""

    # Number n of terms.
    count: int
    # Shortest and longest relaxation time.
    range_s: tuple[float, float]
    # Prior median of the long-term shear modulus.
    modulus_Pa: float
    # Whether the relaxation times are fitted; otherwise they stay evenly spaced in ln(time).
    free_times: bool = True

    @property
    def mean(self) -> Array:
        """The prior means of the unknowns."""
        # ln(long-term modulus), n values ln h, n values ln tau.
        low, high = np.log(self.range_s)
        # The range of times is divided into n intervals of equal length in ln tau. The prior median of tau_i is the
        # middle of interval i.
        middle = low + (high - low) * (np.arange(self.count) + 0.5) / self.count
        return np.concatenate([[np.log(self.modulus_Pa)], np.full(self.count, np.log(_SHARE)), middle])

    @property
    def sigma(self) -> Array:
        """The prior standard deviations of the unknowns."""
        low, high = np.log(self.range_s)
        # The standard deviation of ln tau_i is half of such an interval.
        spacing = (high - low) / (2 * self.count) if self.free_times else _HELD_SIGMA
        return np.concatenate([[MODULUS_SIGMA], np.full(self.count, _SHARE_SIGMA), np.full(self.count, spacing)])

    def split(self, unknowns: Array) -> tuple[Array, Prony]:
        """Convert the unknowns of many candidate laws to instantaneous shear moduli and Prony series."""
        # ``unknowns`` (P, 1 + 2 n) gives P moduli in Pa.
        n = self.count
        long_term = np.exp(unknowns[:, 0])
        h = np.exp(np.clip(unknowns[:, 1 : 1 + n], -30, 10))
        whole = 1 + h.sum(axis=1)
        return long_term * whole, Prony(h / whole[:, None], np.exp(unknowns[:, 1 + n : 1 + 2 * n]))
