"""Search again for the beam in load steps in which it was not found, with the help of neighbouring load steps."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from eimi_lab.vision.check import leaves_out
from eimi_lab.vision.edges.edge_set import EdgeSet

Array = NDArray[np.float64]


class SearchAgain(Protocol):
    """Function that finds the edges of the beam in one load step with the help of other load steps."""

    def __call__(self, index: int, guide: EdgeSet, *lines_mm: Array) -> EdgeSet:
        """Find the edges of the beam in the load step with the number `index`.

        If several bodies may be the beam, the body nearest to the edges `guide` is taken. `lines_mm` are centre lines,
        shape (n, 2), of the beam in one or two other load steps: the beam is expected near this line or between both.
        """


def search_beside_neighbours(edge_sets: list[EdgeSet], search_again: SearchAgain, width_mm: float) -> None:
    """Search again for the beam in load steps in which it was not found, with the help of neighbouring load steps.

    Parameters
    ----------
    edge_sets : list of EdgeSet
        The edges of each load step, which are changed in place.
    search_again : callable
        Function that finds the edges in one load step.
    width_mm : float
        Width of the beam.
    """
    states = range(len(edge_sets))
    first_reliable = next((index for index in states if is_reliable(edge_sets[index])), len(edge_sets))
    for order in (states, reversed(states)):
        guide: EdgeSet | None = None
        for index in order:
            before = edge_sets[index]
            if is_reliable(before):
                guide = before
            elif guide is not None and not len(before.middle_mm):
                again = search_again(index, guide, guide.middle_mm)
                if is_reliable(again):
                    edge_sets[index] = guide = again
            elif guide is not None and index < first_reliable and not leaves_out(before.flags):
                edge_sets[index] = search_again(index, guide)
    for index in states:
        if len(edge_sets[index].middle_mm) and not leaves_out(edge_sets[index].flags):
            continue
        earlier = next((one for one in reversed(edge_sets[:index]) if is_reliable(one)), None)
        later = next((one for one in edge_sets[index + 1 :] if is_reliable(one)), None)
        if earlier is not None and later is not None:
            lines = earlier.middle_mm, later.middle_mm
            again = search_again(index, earlier, *lines)
            if is_reliable(again) and _lies_between(again.middle_mm, *lines, width_mm):
                edge_sets[index] = again


def is_reliable(edge_set: EdgeSet) -> bool:
    """Return whether the edges of a load step are reliable enough to guide the search in other load steps."""
    guessed = any(flag.name == "ROOT_AMBIGUOUS" for flag in edge_set.flags)
    return bool(len(edge_set.middle_mm)) and not guessed and not leaves_out(edge_set.flags)


def _lies_between(middle_mm: Array, earlier_mm: Array, later_mm: Array, width_mm: float) -> bool:
    """Return whether a middle line lies between two others, with a tolerance of half of the beam's width.

    Each line is an array of n points (x, y) in mm, shape (n, 2).
    """
    to_earlier, to_later = (_distances(middle_mm, line) for line in (earlier_mm, later_mm))
    apart = _distances(earlier_mm, later_mm).max()
    return bool((to_earlier + to_later).max() < apart + 0.5 * width_mm)


def _distances(points: Array, line: Array) -> Array:
    """Return the distances of n points from the nearest of m points of a line, shape (n,)."""
    return np.asarray(np.linalg.norm(points[:, None] - line, axis=2).min(axis=1))
