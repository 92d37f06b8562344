"""Find systematic errors that the residuals cannot distinguish, and give them equal probabilities."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Hypothesis = tuple[int, ...]

# If one of two causes is true, the mean logarithm of the odds between them is half the squared distance.
_TOLD_APART = 2 * np.log(9.0)
_OF_CHANGE = 0.02  # difference of two simulated changes, each of which has an error of 1 per cent
_LARGEST_CLASS = 3


def classes(
    remaining: Array, amplitudes: Sequence[int], evidence: Array, negligible: NDArray[np.bool_]
) -> list[tuple[int, ...]]:
    """Group the systematic errors (given by their numbers) that the residuals cannot distinguish."""
    # remaining (1 + M, N): residuals in units of the noise, after a fit without a systematic error and with each of M
    # errors. amplitudes: number of components of each error, such as two for a shift in x and y. evidence (M,):
    # logarithm of the probability density of the residuals with each error. negligible (M,): whether the size of the
    # error is negligible.
    # Two errors are alike if the squared distance of their remaining residuals is below 2 ln 9 (odds of 9 to 1) plus
    # the error of this distance.
    counts = np.asarray(amplitudes)
    explained = remaining[0] - remaining[1:]
    squares = (explained**2).sum(axis=1)
    explains = (squares > _TOLD_APART + counts) & ~negligible
    apart = ((explained[:, None] - explained) ** 2).sum(axis=-1)
    # Each fitted size increases the squared distance by about 1. Each simulated change may be wrong by 1 per cent.
    of_simulation = _OF_CHANGE**2 * np.minimum(squares[:, None], squares)
    alike = (apart < _TOLD_APART + counts[:, None] + counts + of_simulation) & explains[:, None] & explains
    unassigned = [int(cause) for cause in np.argsort(-evidence)]
    all_classes = []
    while unassigned:
        first = unassigned.pop(0)
        members = (first, *[cause for cause in unassigned if alike[first, cause]][: _LARGEST_CLASS - 1])
        unassigned = [cause for cause in unassigned if cause not in members]
        all_classes.append(members)
    return all_classes


def shared_equally(
    score: Array,
    hypotheses: Sequence[Hypothesis],
    is_uncertain: NDArray[np.bool_],
    of_causes: Sequence[tuple[int, ...]],
) -> Array:
    """Divide the probability equally between systematic errors that the residuals cannot distinguish."""
    # score (H,): logarithm of the probability of each set of causes. is_uncertain (H,): whether the set also contains
    # errors within the stated uncertainties. of_causes: the groups from `classes`.
    # The data do not decide between the causes of a class. Their evidence differs only by their assumed usual sizes:
    # for a scale that is wrong by 3 per cent (3 usual errors), it favours a beam that is 9 mm nearer (1.8 usual
    # errors).
    number = {cause: i for i, members in enumerate(of_causes) for cause in members}
    groups: dict[tuple[bool, tuple[int, ...]], list[int]] = {}
    for row, hypothesis in enumerate(hypotheses):
        key = bool(is_uncertain[row]), tuple(sorted(number[cause] for cause in hypothesis))
        groups.setdefault(key, []).append(row)
    result = np.array(score)
    for rows in groups.values():
        result[rows] = np.logaddexp.reduce(score[rows]) - np.log(len(rows))
    return result
