"""Compute the probability of each systematic error, such as a wrong scale, from the residuals of a fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.doubts.collinear_causes import shared_equally
from eimi_fitting.inference.doubts.deviating_inputs import Deviation, deviations
from eimi_fitting.inference.doubts.possible_causes import PossibleCause
from eimi_fitting.inference.doubts.signatures import LinearisedFit, columns_of
from eimi_fitting.inference.doubts.stated_inputs import stated_columns
from eimi_fitting.inference.doubts.table_of_causes import POSSIBLE_CAUSES
from eimi_fitting.inference.doubts.weighing import Weighing
from eimi_fitting.inference.evidence.objective import Evaluation, Problem
from eimi_fitting.inference.interval.noise import Effect
from eimi_fitting.inference.searching.polish import Optimum

Array = NDArray[np.float64]

_PROBABLE = 0.95  # probability of the hypotheses whose changes of the modulus are reported
_WITHIN = 2.0  # standard uncertainties up to which a deviation is within what the files state
_LEAST = 1e-3  # probability below which a cause is left out of the result
NONE = "none"


@dataclass(frozen=True)
class Cause:
    """A systematic error, such as a wrong scale, with the probability that it is present."""

    # "none" stands for "no listed error".
    name: str
    probability: float
    # Expected size of the error in its unit; the unit "1" is a share.
    value: float
    unit: str
    # Change of the initial shear modulus by a correction for an error of this size, in per cent.
    shift_percent: float
    # The measurement that decides whether the error is present.
    decide_by: str
    # Names of the errors with similar effects on the residuals.
    like: tuple[str, ...] = ()
    # Whether the size of the error is within its stated uncertainty.
    is_within_stated: bool = False


@dataclass(frozen=True)
class Weighed:
    """The probabilities of all systematic errors, such as a wrong scale, given the residuals of a fit."""

    # The most probable error comes first.
    causes: tuple[Cause, ...]
    # Names of the errors whose sizes were fitted or measured.
    in_the_fit: frozenset[str]
    # For each error and each experiment, the root mean square residual of each load case after a correction.
    error_mm: dict[str, tuple[Array, ...]]
    # Smallest and largest change of the initial shear modulus by the probable combinations of errors.
    modulus_percent: tuple[float, float] = (0.0, 0.0)
    # Names of the errors in the most probable combination.
    most_probable: frozenset[str] = frozenset()
    # Probability of any error that is not in `in_the_fit`.
    beside_the_fit: float = 0.0
    # (K, 2, m) for each experiment: residuals in mm after a correction for the most probable combination, in K load
    # cases, at m points of the two edges.
    remaining: tuple[Array, ...] | None = None
    # Probability that no systematic error is present.
    as_stated: float = 0.0


def weighed_causes(
    problem: Problem,
    optimum: Optimum[Evaluation],
    effects: Sequence[Effect] = (),
    possible: Sequence[PossibleCause] = POSSIBLE_CAUSES,
) -> Weighed:
    """Compute the probability of each systematic error, such as a wrong scale, from the residuals of a fit."""
    # A hypothesis is a set of at most two systematic errors ("causes"). It describes the residuals r in mm by
    #
    #     -r = J dx + sum_a C_a s_a + d + e
    #     dx ~ N(0, inv(P)),   s_a ~ N(0, size_a^2),   d ~ N(0, eta^2 G),   e ~ N(0, sigma^2 T)
    #
    #     dx    change of the unknowns of the law; P is its prior precision, J the derivative of r
    #     s_a   size of the error a; size_a is the usual size, C_a the derivative of r
    #     d     unexplained error with the unknown size eta in mm and the smooth covariance G
    #     e     noise with the standard deviation sigma and the correlation matrix T
    #
    # The probability of a hypothesis with h of the M errors is proportional to p(r | hypothesis) (M - 1)^-h.
    if not possible:
        return Weighed((), frozenset(), {})
    fit = LinearisedFit.of(problem, optimum, possible)
    if not fit.solved:
        return Weighed((), frozenset(), {})
    columns_by_cause = {cause: columns for cause in possible if (columns := columns_of(fit, cause))}
    # The result is empty if no error changes the residuals, or if the optimum has no equilibrium.
    if not columns_by_cause:
        return Weighed((), frozenset(), {})
    weighing = Weighing(fit, effects, stated_columns(fit, possible), columns_by_cause)
    posterior = weighing.evidence_of_sets()
    of_causes = weighing.classes(posterior)
    score = shared_equally(
        posterior.log_evidence + weighing.log_prior, weighing.hypotheses, weighing.is_uncertain, of_causes
    )
    names = [cause.name for cause in columns_by_cause]
    probability = np.exp(score - score.max())
    probability /= probability.sum()
    best = int(np.argmax(score))
    singly = posterior.take(weighing.alone(best))
    order = {cause: -evidence for cause, evidence in enumerate(singly.log_evidence[1:])}
    within = deviations(weighing, posterior, best) if weighing.is_uncertain[best] else {}
    moved_by_causes = _moved_by_causes(weighing, posterior.means, probability)
    freed = {nuisance.source for nuisance in problem.unknowns.freed}
    in_the_fit = frozenset(
        cause.name
        for cause, columns in columns_by_cause.items()
        if cause.source in freed or any(column.start for column in columns)
    )
    is_none = np.array([not hypothesis for hypothesis in weighing.hypotheses])
    no_deviation = float(np.prod([1 - one for one in _of_classes(within)]))
    # The probability that no cause is present and that the residuals show no deviation of an input.
    nothing = float(probability[is_none] @ np.where(weighing.is_uncertain, no_deviation, 1.0)[is_none])
    causes, errors = [Cause(NONE, nothing, 0.0, "", 0.0, "")], {}
    for i, cause in enumerate(columns_by_cause):
        alone = singly.means[1 + i]
        errors[cause.name] = weighing.remaining_mm(alone)
        holds = np.array([i in hypothesis for hypothesis in weighing.hypotheses])
        beyond = float(probability[holds].sum())
        without = float(probability[weighing.is_uncertain & ~holds].sum())
        stated = within.get(i)
        # The error may also be present within its stated uncertainty. It then is no cause of the hypothesis.
        total = beyond + without * (stated.probability if stated else 0.0)
        if total < _LEAST:
            continue
        if stated and without * stated.probability > beyond:
            size, moved, members = stated.value, stated.moved, stated.like
        else:
            mean = probability[holds] @ posterior.means[holds] / beyond
            amplitudes = mean[weighing.blocks[i][: weighing.shown(i)]]
            size = float(np.copysign(np.linalg.norm(amplitudes), amplitudes[np.argmax(np.abs(amplitudes))]))
            moved = float(probability[holds] @ moved_by_causes[holds, i] / beyond)
            members = next(tuple(other for other in group if other != i) for group in of_causes if i in group)
        is_within = abs(size) <= _WITHIN * weighing.stated_size(i)
        shift, like = problem.unknowns.modulus_percent(moved), tuple(names[other] for other in members)
        causes.append(Cause(cause.name, total, size, cause.unit, shift, cause.decide_by, like, is_within))
    causes.sort(key=lambda cause: order[names.index(cause.name)] if cause.name in names else 0.0)
    causes.sort(key=lambda cause: -round(cause.probability, 6))  # the evidence orders the causes of a class
    moved_by = posterior.means[_most_probable(probability), 0]
    shifts = tuple(problem.unknowns.modulus_percent(float(end)) for end in (moved_by.min(), moved_by.max()))
    further = [any(names[i] not in in_the_fit for i in hypothesis) for hypothesis in weighing.hypotheses]
    return Weighed(
        tuple(causes),
        in_the_fit,
        errors,
        (shifts[0], shifts[1]),
        frozenset(names[i] for i in weighing.hypotheses[best]),
        float(probability[further].sum()),
        weighing.remaining(best, posterior.means[best]) if further[best] or weighing.is_uncertain[best] else None,
        float(probability[is_none].sum()),
    )


def _moved_by_causes(weighing: Weighing, means: Array, probability: Array) -> Array:
    # (H, M): change of the first unknown by each of M errors under each of H hypotheses.
    by_unit = weighing.moved_by_unit()
    moved = np.stack([means[:, rows] @ by_unit[rows] for rows in weighing.blocks], axis=1)
    in_the_fit = sum(float(weighing.starts(i) @ by_unit[rows]) for i, rows in enumerate(weighing.blocks))
    holds = np.array([[i in hypothesis for i in range(len(weighing.blocks))] for hypothesis in weighing.hypotheses])
    # Nonlinear effects, and those of the weights of the residuals, belong to the more probable error of a hypothesis.
    main = np.argmax(np.where(holds, probability @ holds, -1.0), axis=1)
    moved[np.arange(len(moved)), main] += means[:, 0] + in_the_fit - moved.sum(axis=1)
    return np.where(holds, moved, 0.0)


def _of_classes(within: Mapping[int, Deviation]) -> list[float]:
    # For each group of inputs with similar effects, the probability that one of them is wrong.
    groups = {frozenset({cause, *one.like}) for cause, one in within.items()}
    return [min(sum(within[cause].probability for cause in group), 1.0) for group in groups]


def _most_probable(probability: Array) -> NDArray[np.intp]:
    # Indices of the most probable sets of causes, which together have the probability 0.95.
    order = np.argsort(-probability, kind="stable")
    return order[: int(np.searchsorted(np.cumsum(probability[order]), _PROBABLE)) + 1]
