"""Find the uncertain inputs, such as a width, that are probably wrong according to the residuals of a fit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.doubts.marginal_likelihood import Posterior
from eimi_fitting.inference.doubts.weighing import NEGLIGIBLE, Exact, Weighing

Array = NDArray[np.float64]

# An input may deviate if its estimated error changes the residuals by a chi-square of at least this number. A smaller
# chi-square favours a deviation by odds below 9 to 1.
_SEEN = 2 * np.log(9.0)


@dataclass(frozen=True)
class Deviation:
    """An error of an input, such as the width, that is not larger than its uncertainty allows."""

    # Index in the list of systematic errors.
    cause: int
    # Probability that the error is not negligible.
    probability: float
    value: float
    # Change of the first unknown of the fit by a correction for the error, scaled to 0..1 between its bounds.
    moved: float
    # Indices of the errors with similar effects on the residuals.
    like: tuple[int, ...]


def deviations(weighing: Weighing, posterior: Posterior, base: int) -> dict[int, Deviation]:
    """Find the uncertain inputs, such as the width, that are probably wrong according to the residuals of a fit."""
    # A key of the result is the index of a cause. `base` is the index of the most probable set of causes.
    recognised: dict[int, Deviation] = {}
    for cause in range(len(weighing.blocks)):
        rows = weighing.rows_of_inputs(cause)
        # An error of the most probable set is a cause, and not a deviation within the uncertainty.
        if not rows or cause in weighing.hypotheses[base]:
            continue
        if weighing.squares_of(base, posterior, rows) < _SEEN:
            continue
        # The causes are compared again with this input exact. Its deviation then competes with the other causes.
        exact = weighing.if_exact(base, rows)
        group = next(members for members in exact.classes if cause in members)
        for member in group:
            shown = weighing.blocks[member][: weighing.shown(member)]
            amplitudes = exact.posterior.means[1 + exact.causes.index(member), shown]
            if member == cause:
                amplitudes = weighing.as_cause(rows, posterior.means[base, rows], cause)
            # Without other errors, a correction moves the first unknown from its fitted value.
            is_moved = bool(weighing.hypotheses[base]) or weighing.starts(member).any()
            before = float(exact.posterior.means[0, 0]) if is_moved else 0.0
            one = _deviation(weighing, exact, member, amplitudes, group, before)
            if not is_moved and weighing.has_several_inputs:
                # The posterior also contains the effects of the other inputs; this is the effect of one input alone.
                one = replace(one, moved=float(weighing.moved_in_fit(shown) @ amplitudes))
            if member not in recognised or recognised[member].probability < one.probability:
                recognised[member] = one
    return recognised


def _deviation(
    weighing: Weighing, exact: Exact, cause: int, amplitudes: Array, group: tuple[int, ...], before: float
) -> Deviation:
    # ``before``: the first unknown of the fit before a correction for this error, relative to its fitted value.
    row, shown = 1 + exact.causes.index(cause), weighing.blocks[cause][: weighing.shown(cause)]
    in_sizes = amplitudes / weighing.scale(shown)
    largest = int(np.argmax(np.abs(in_sizes)))
    mean = exact.posterior.means[row, shown[largest]] / weighing.scale(shown)[largest]
    spread = np.sqrt(max(exact.posterior.squares[row, shown[largest]] - mean**2, 1e-12))
    beyond = sum(NormalDist().cdf((sign * in_sizes[largest] - NEGLIGIBLE) / spread) for sign in (1, -1))
    moved = float(exact.posterior.means[row, 0]) - before
    moved += float(weighing.moved_by_unit()[shown] @ (amplitudes - exact.posterior.means[row, shown]))
    return Deviation(
        cause,
        float(exact.probability[row] * beyond),
        float(np.copysign(np.linalg.norm(amplitudes), amplitudes[np.argmax(np.abs(amplitudes))])),
        moved,
        tuple(other for other in group if other != cause),
    )
