"""Find the inputs, such as a width, that the residuals show to differ from their stated values.

The difference is within the uncertainty that a file states, and is therefore no error of the test bench. Its
probability is computed because it may still be the reason for the residuals.
"""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.doubts.marginal_likelihood import Posterior
from eimi_fitting.inference.doubts.weighing import NEGLIGIBLE, Exact, Weighing

Array = NDArray[np.float64]

_SEEN = 2 * np.log(9.0)  # a smaller change of the squares favours a deviation by less than 9 to 1


@dataclass(frozen=True)
class Deviation:
    """A difference of an input from its stated value, within its uncertainty, that the residuals of a fit show.

    Parameters
    ----------
    cause : int
        Index of the error that consists in this difference, such as "wrong scale", in the list of possible errors of
        the test bench.
    probability : float
        Probability that the difference is present and not negligible.
    value : float
        Size of the difference in the unit of the error.
    moved : float
        Change of the first unknown of the law by the difference. The unknown varies from 0 to 1 between its bounds.
    like : tuple of int
        Indices of the other errors that would change the residuals in nearly the same way.
    """

    cause: int
    probability: float
    value: float
    moved: float
    like: tuple[int, ...]


def deviations(weighing: Weighing, posterior: Posterior, base: int) -> dict[int, Deviation]:
    """Return the differences of inputs from their stated values, within their uncertainties, that the residuals show.

    Example: a width that is wrong by twice its stated uncertainty. A larger error of the width would be an error of the
    test bench.

    Parameters
    ----------
    weighing : Weighing
        The comparison of sets of errors of the test bench.
    posterior : Posterior
        The probability density of the residuals and the sizes of all errors, for each set.
    base : int
        Index of the most probable set. Its errors are omitted: they count as errors of the test bench.

    Returns
    -------
    dict of int to Deviation
        The differences. A key is the index of the error that consists in the difference, in the list of possible errors
        of the test bench.
    """
    recognised: dict[int, Deviation] = {}
    for cause in range(len(weighing.blocks)):
        rows = weighing.rows_of_inputs(cause)
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
            one = _deviation(weighing, exact, member, amplitudes, group)
            if member not in recognised or recognised[member].probability < one.probability:
                recognised[member] = one
    return recognised


def _deviation(weighing: Weighing, exact: Exact, cause: int, amplitudes: Array, group: tuple[int, ...]) -> Deviation:
    row, shown = 1 + exact.causes.index(cause), weighing.blocks[cause][: weighing.shown(cause)]
    in_sizes = amplitudes / weighing.scale(shown)
    largest = int(np.argmax(np.abs(in_sizes)))
    mean = exact.posterior.means[row, shown[largest]] / weighing.scale(shown)[largest]
    spread = np.sqrt(max(exact.posterior.squares[row, shown[largest]] - mean**2, 1e-12))
    beyond = sum(NormalDist().cdf((sign * in_sizes[largest] - NEGLIGIBLE) / spread) for sign in (1, -1))
    return Deviation(
        cause,
        float(exact.probability[row] * beyond),
        float(np.copysign(np.linalg.norm(amplitudes), amplitudes[np.argmax(np.abs(amplitudes))])),
        float(exact.posterior.means[row, 0] - exact.posterior.means[0, 0]),
        tuple(other for other in group if other != cause),
    )
