"""Choose the candidates with which a criterion, such as the variance of the modulus, is smallest.

The chosen candidates are exchanged one at a time for the candidate that helps most, until no exchange helps (Fedorov
1972, Theory of Optimal Experiments, section 3.3; Atkinson and Donev 1992, Optimum Experimental Designs, section 15.4).
The exchange starts twice: from equally spaced candidates, and from the candidates that help most when chosen one by
one.
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
    """The criterion that a choice of states minimises."""

    def __len__(self) -> int:
        """Return the number of candidate states."""

    def variance(self, choices: Choice) -> Array:
        """Return the value (D,) to be minimised, for D choices (D, K) of states."""


def equally_spaced(states: int, count: int) -> Choice:
    """Return the indices (count,) of candidates that are equally spaced from the first to the last."""
    return np.unique(np.round(np.linspace(0, states - 1, count)).astype(int))


def exchange(criterion: Criterion, count: int) -> Choice:
    """Choose distinct candidates so that no exchange of a single candidate improves the criterion.

    Parameters
    ----------
    criterion : Criterion
        The candidates and the value to be minimised.
    count : int
        Number of states to choose.

    Returns
    -------
    ndarray of int, shape (count,)
        Indices of the chosen candidates in ascending order.

    Raises
    ------
    ValueError
        If there are fewer candidates than states to choose.
    """
    if count > len(criterion):
        raise ValueError(f"cannot choose {count} states of {len(criterion)} candidates")
    starts = [equally_spaced(len(criterion), count), _filled(criterion, count)]
    ends = [_exchanged(criterion, choice) for choice in starts]
    return np.sort(min(ends, key=lambda choice: float(criterion.variance(choice[None])[0])))


def _filled(criterion: Criterion, count: int) -> Choice:
    """Choose candidates one by one, each time the one that lowers the criterion most."""
    chosen: list[int] = []
    while len(chosen) < count:
        others = np.setdiff1d(np.arange(len(criterion)), chosen)
        tried = np.column_stack([np.tile(np.array(chosen, int), (len(others), 1)), others])
        chosen = [*chosen, int(others[np.argmin(criterion.variance(tried))])]
    return np.array(chosen)


def _exchanged(criterion: Criterion, choice: Choice) -> Choice:
    """Exchange chosen states for other candidates until no single exchange lowers the criterion."""
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
