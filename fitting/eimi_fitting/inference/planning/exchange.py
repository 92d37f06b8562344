"""Choose the states (loads) to measure for which a criterion, such as the variance of the modulus, is smallest.

One chosen state at a time is exchanged for the state that lowers the criterion most. The method ends if no exchange
lowers the criterion (Fedorov 1972, Theory of Optimal Experiments, section 3.3; Atkinson and Donev 1992, Optimum
Experimental Designs, section 15.4). It starts from two choices of states, and the better result is taken. The states of
the first choice are equally spaced. The second choice is built state by state, each time with the state that lowers the
criterion most.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Choice = NDArray[np.intp]

_SWEEPS = 20
_GAIN = 1e-6  # smallest relative gain of the criterion for which a state is exchanged


class Criterion(Protocol):
    """The states that could be measured, and a function that is small for a good choice of states."""

    def __len__(self) -> int:
        """Return the number of states that could be measured."""

    def variance(self, choices: Choice) -> Array:
        """Return the criterion, such as the variance of the modulus, for each of D choices of K states, (D,).

        Each row of ``choices`` (D, K) has the indices of K states.
        """


def equally_spaced(states: int, count: int) -> Choice:
    """Return ``count`` indices at equal distances, from the first to the last of ``states`` states."""
    return np.unique(np.round(np.linspace(0, states - 1, count)).astype(int))


def exchange(criterion: Criterion, count: int) -> Choice:
    """Choose ``count`` different states for which a criterion, such as the variance of the modulus, is small.

    Parameters
    ----------
    criterion : Criterion
        The states that could be measured, with the function to be minimised.
    count : int
        Number of states to choose.

    Returns
    -------
    ndarray of int, shape (count,)
        Indices of the chosen states in ascending order.

    Raises
    ------
    ValueError
        If fewer than ``count`` states could be measured.
    """
    if count > len(criterion):
        raise ValueError(f"cannot choose {count} states: only {len(criterion)} states could be measured")
    starts = [equally_spaced(len(criterion), count), _filled(criterion, count)]
    ends = [_exchanged(criterion, choice) for choice in starts]
    return np.sort(min(ends, key=lambda choice: float(criterion.variance(choice[None])[0])))


def _filled(criterion: Criterion, count: int) -> Choice:
    """Return the indices of ``count`` states, chosen one by one so that each state lowers the criterion most."""
    chosen: list[int] = []
    while len(chosen) < count:
        others = np.setdiff1d(np.arange(len(criterion)), chosen)
        tried = np.column_stack([np.tile(np.array(chosen, int), (len(others), 1)), others])
        chosen = [*chosen, int(others[np.argmin(criterion.variance(tried))])]
    return np.array(chosen)


def _exchanged(criterion: Criterion, choice: Choice) -> Choice:
    """Return a choice of states in which single states are exchanged until no exchange lowers the criterion."""
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
