"""Find causes (errors of the bench) that change the residuals alike, and give these causes equal probabilities.

Let e_0 be the remaining residuals without a cause. Let e_a be the remaining residuals if only the cause a is present,
with its most probable amplitudes. e_0 and e_a are computed after the most probable changes of the law, in units of the
noise. The difference S_a = e_0 - e_a is the part of the residuals that the cause a explains and the law does not
explain. Let two causes a and b have the angle phi between S_a and S_b, and let S_a and S_b have the same length |S|.
Then

    |e_a - e_b|^2 = |S_a - S_b|^2 = 4 |S|^2 sin^2(phi / 2)

If one of the two causes is true and the noise is normal, the logarithm of the odds between the two causes is |e_a -
e_b|^2 / 2 on average. The causes are alike if the data favour the true cause by less than 9 to 1. Then |e_a - e_b|^2 is
below 2 ln 9 plus the number of amplitudes of both causes, because noise adds 1 for each amplitude. Probable causes are
simulated at their amplitudes, so that the angle does not depend on the size up to which the residuals change linearly.
Causes that are alike form a class of at most three. A class has one member if the value of the cause is negligible, and
only other amplitudes of the cause explain the residuals.

The data do not decide between the causes of a class. The evidence (the probability density of the residuals) of these
causes differs only because their assumed usual sizes differ. Example: a scale that is wrong by 3 per cent and a beam
that is 9 mm nearer change the residuals alike. 3 per cent are three usual sizes of the first cause, so that the
evidence would favour the second cause, even if the scale is wrong. The hypotheses (sets of causes) that differ only by
the choice within a class therefore share their probability equally, because their prior probabilities are equal.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Hypothesis = tuple[int, ...]

_TOLD_APART = 2 * np.log(9.0)
_LARGEST_CLASS = 3


def classes(
    remaining: Array, amplitudes: Sequence[int], evidence: Array, negligible: NDArray[np.bool_]
) -> list[tuple[int, ...]]:
    """Put causes (possible errors of the bench) that the residuals do not distinguish into one class.

    Parameters
    ----------
    remaining : ndarray, shape (1 + M, N)
        The N residuals that remain, in units of the noise. The first row remains if no cause is present, and each
        further row if only one of the M causes is present.
    amplitudes : sequence of int, length M
        Number of amplitudes of each cause: the sizes of its parts, such as a shift in x and in y.
    evidence : ndarray, shape (M,)
        Logarithm of the evidence (probability density of the residuals) if only this cause is present, for each cause.
    negligible : ndarray of bool, shape (M,)
        Whether the size of each cause is negligible.

    Returns
    -------
    list of tuple of int
        The indices of the causes in each class (group), the cause with the largest evidence first. Every cause belongs
        to one class, which may have one member.
    """
    counts = np.asarray(amplitudes)
    explained = remaining[0] - remaining[1:]
    explains = ((explained**2).sum(axis=1) > _TOLD_APART + counts) & ~negligible
    apart = ((explained[:, None] - explained) ** 2).sum(axis=-1)
    alike = (apart < _TOLD_APART + counts[:, None] + counts) & explains[:, None] & explains
    unassigned = [int(cause) for cause in np.argsort(-evidence)]
    all_classes = []
    while unassigned:
        first = unassigned.pop(0)
        members = (first, *[cause for cause in unassigned if alike[first, cause]][: _LARGEST_CLASS - 1])
        unassigned = [cause for cause in unassigned if cause not in members]
        all_classes.append(members)
    return all_classes


def shared_equally(score: Array, hypotheses: Sequence[Hypothesis], of_causes: Sequence[tuple[int, ...]]) -> Array:
    """Return the logarithms of the probabilities of hypotheses, with equal probabilities for indistinguishable causes.

    A hypothesis is a set of causes (possible errors of the bench) that are present.

    Parameters
    ----------
    score : ndarray, shape (H,)
        Logarithm of the probability of each of H hypotheses, from the probability density of the residuals.
    hypotheses : sequence of tuple of int
        Indices of the causes of each hypothesis.
    of_causes : sequence of tuple of int
        The classes (groups of causes that the residuals do not distinguish), each as indices of its causes.

    Returns
    -------
    ndarray, shape (H,)
        Logarithm of the probability of each hypothesis.
    """
    number = {cause: i for i, members in enumerate(of_causes) for cause in members}
    groups: dict[tuple[int, ...], list[int]] = {}
    for row, hypothesis in enumerate(hypotheses):
        groups.setdefault(tuple(sorted(number[cause] for cause in hypothesis)), []).append(row)
    result = np.array(score)
    for rows in groups.values():
        result[rows] = np.logaddexp.reduce(score[rows]) - np.log(len(rows))
    return result
