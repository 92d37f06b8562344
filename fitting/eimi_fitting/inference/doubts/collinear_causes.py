"""Find causes (errors of the test bench) that change the residuals alike, and give them equal probabilities.

When are two causes alike? Let e_0 be the vector of the residuals after a fit without any cause, and e_a that after a
fit with the cause a, both in units of the noise. S_a = e_0 - e_a is the part of the residuals that the cause a explains
and the law does not explain. If S_a and S_b of two causes have the same length |S| and the angle phi between them,

    |e_a - e_b|^2 = |S_a - S_b|^2 = 4 |S|^2 sin^2(phi / 2).

Assume that one of the two causes is true and that the noise is normal. The logarithm of the odds between the causes is
then |e_a - e_b|^2 / 2 on average. Two causes count as alike if the odds are below 9 to 1, that is, if |e_a - e_b|^2 is
below 2 ln 9. Two amounts are added to this limit. Each size of a cause is fitted to noisy residuals, which increases
|e_a - e_b|^2 by about 1: the number of fitted sizes of both causes is added. The simulated S_a and S_b may each be
wrong by 1 per cent: (0.02 |S|)^2 is added.

Causes that are alike form a class of at most three. A cause of negligible size is alone in its class.

The data do not decide between the causes of a class. Their evidence (the probability density of the residuals) differs
only because their assumed usual sizes differ. Example: a scale that is wrong by 3 per cent and a beam that is 9 mm
nearer to the camera change the residuals alike. The usual error is 1 per cent for a scale and 5 mm for a distance. The
evidence would therefore favour the distance (1.8 instead of 3 usual errors), even if the scale is wrong. For this
reason, sets of causes that differ only by the choice within a class share their probability equally.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Hypothesis = tuple[int, ...]

_TOLD_APART = 2 * np.log(9.0)
_OF_CHANGE = 0.02  # difference of two simulated changes, each of which has an error of 1 per cent
_LARGEST_CLASS = 3


def classes(
    remaining: Array, amplitudes: Sequence[int], evidence: Array, negligible: NDArray[np.bool_]
) -> list[tuple[int, ...]]:
    """Group the possible errors of the test bench (causes) that the residuals do not distinguish.

    Parameters
    ----------
    remaining : ndarray, shape (1 + M, N)
        N residuals in units of the noise. The first row is from a fit without any cause, and each further row from a
        fit with one of the M causes.
    amplitudes : sequence of int, length M
        How many fitted numbers describe each cause; two for a shift in x and y.
    evidence : ndarray, shape (M,)
        Logarithm of the probability density of the residuals with each cause alone.
    negligible : ndarray of bool, shape (M,)
        Whether the size of each cause is negligible.

    Returns
    -------
    list of tuple of int
        The indices of the causes in each group, the most probable first. Every cause belongs to one group, which may
        have one member.
    """
    counts = np.asarray(amplitudes)
    explained = remaining[0] - remaining[1:]
    squares = (explained**2).sum(axis=1)
    explains = (squares > _TOLD_APART + counts) & ~negligible
    apart = ((explained[:, None] - explained) ** 2).sum(axis=-1)
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
    """Divide the probability equally between errors of the test bench (causes) that the residuals do not distinguish.

    Parameters
    ----------
    score : ndarray, shape (H,)
        Logarithms of the probabilities of H sets of causes.
    hypotheses : sequence of tuple of int
        The sets of causes, each as indices of its causes.
    is_uncertain : ndarray of bool, shape (H,)
        Whether inputs such as the width may be wrong within their stated uncertainties, in addition to the causes of
        the set (True), or have exactly their stated values. Probability is divided only between sets with the same
        value.
    of_causes : sequence of tuple of int
        The groups of causes that the residuals do not distinguish, as indices.

    Returns
    -------
    ndarray, shape (H,)
        Logarithm of the new probability of each set.
    """
    number = {cause: i for i, members in enumerate(of_causes) for cause in members}
    groups: dict[tuple[bool, tuple[int, ...]], list[int]] = {}
    for row, hypothesis in enumerate(hypotheses):
        key = bool(is_uncertain[row]), tuple(sorted(number[cause] for cause in hypothesis))
        groups.setdefault(key, []).append(row)
    result = np.array(score)
    for rows in groups.values():
        result[rows] = np.logaddexp.reduce(score[rows]) - np.log(len(rows))
    return result
