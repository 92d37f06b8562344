"""Choose the load cases to measure for which a criterion, such as the variance of the modulus, is smallest."""

# One load case at a time is exchanged for the one that lowers the criterion most (Fedorov 1972, Theory of Optimal
# Experiments, section 3.3; Atkinson and Donev 1992, Optimum Experimental Designs, section 15.4).

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Choice = NDArray[np.intp]

_SWEEPS = 20
_GAIN = 1e-6  # smallest relative gain of the criterion for which a state is exchanged


class Criterion(Protocol):
    """A quantity that is small for a good choice of load cases, such as the variance of the modulus."""

    def __len__(self) -> int:
        """Return the number of possible load cases."""

    def variance(self, choices: Choice) -> Array:
        """Return the quantity to make small, such as a variance, for several choices of load cases."""


def equally_spaced(states: int, count: int) -> Choice:
    """Return ``count`` indices at equal distances, from 0 to ``states`` - 1."""
    return np.unique(np.round(np.linspace(0, states - 1, count)).astype(int))


def exchange(criterion: Criterion, count: int) -> Choice:
    """Choose load cases for which a criterion, such as the variance of the modulus, is small."""
    # Raises ValueError if there are fewer than `count` load cases.
    if count > len(criterion):
        raise ValueError(f"cannot choose {count} states: only {len(criterion)} states could be measured")
    # The first choice is equally spaced, the second is built one by one. The better result is taken.
    starts = [equally_spaced(len(criterion), count), _filled(criterion, count)]
    ends = [_exchanged(criterion, choice) for choice in starts]
    return np.sort(min(ends, key=lambda choice: float(criterion.variance(choice[None])[0])))


def _filled(criterion: Criterion, count: int) -> Choice:
    # Each load case is chosen so that it lowers the criterion most.
    chosen: list[int] = []
    while len(chosen) < count:
        others = np.setdiff1d(np.arange(len(criterion)), chosen)
        tried = np.column_stack([np.tile(np.array(chosen, int), (len(others), 1)), others])
        chosen = [*chosen, int(others[np.argmin(criterion.variance(tried))])]
    return np.array(chosen)


def _exchanged(criterion: Criterion, choice: Choice) -> Choice:
    # Exchange load cases until no exchange of one load case lowers the criterion.
    best = float(criterion.variance(choice[None])[0])
    for _ in range(_SWEEPS):
        before = best
        for place in range(len(choice)):
            others = np.setdiff1d(np.arange(len(criterion)), choice)
            if not len(others):
                return choice
            tried = np.tile(choice, (len(others), 1))
            tried[:, place] = others
            values = criterion.variance(tried)
            if values.min() < best * (1 - _GAIN):
                choice, best = tried[np.argmin(values)], float(values.min())
        if best >= before * (1 - _GAIN):
            break
    return choice
