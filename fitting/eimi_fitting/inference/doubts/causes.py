"""Compute how probable it is that a possible error of the test bench (a cause) has caused the residuals of a fit.

The model. Let r be the residuals in mm at the optimum of the fit, with every input at its stated value. Let J be the
derivatives of r by the unknowns x of the law. A cause a is described by a few numbers s_a (its amplitudes), such as a
shift in x and in y. The signature C_a is the change of the residuals for amplitudes of one. A hypothesis H is a set of
causes that are present. It explains the residuals by

    -r = J dx + sum_{a in H} C_a s_a + d + e
    dx ~ N(0, inv(P)),   s_a ~ N(0, size_a^2),   d ~ N(0, eta^2 G),   e ~ N(0, sigma^2 T)

where dx is a change of the law, P the inverse covariance of its prior, and size_a the usual size of the cause in a
laboratory. The noise e has the standard deviation sigma and the correlation matrix T. The error d is the part that no
listed cause explains. It has the unknown size eta in mm, and its covariance G is smooth along an edge and over the
loads (Kennedy and O'Hagan 2001, J. R. Stat. Soc. B 63:425). J has further columns for the errors that remain after the
corrections by a finer mesh and by a three-dimensional model.

The evidence p(r | H) is the probability density of the residuals. Let L = sigma^2 T + eta^2 G. Let A be the columns of
J and of all C_a, each times its prior standard deviation, and b = A' inv(L) r, where a prime denotes the transpose.
Then

    ln p(r | H, eta) = -1/2 (ln det L + r' inv(L) r) - 1/2 ln det(1 + A' inv(L) A) + 1/2 b' inv(1 + A' inv(L) A) b

except for a constant (Bishop 2006, Pattern Recognition and Machine Learning, section 3.5; Woodbury's identity). The
evidence is averaged over eta = 0 and 17 values from 1e-4 to 1 mm with equal distances in ln eta.

Negligible causes. A second cause of negligible size shall not explain small errors of the beam model. The evidence is
therefore multiplied by (m / (m + 0.3^2))^2 for each cause of H, where m is the posterior mean of |s_a / size_a|^2. If
the reported size of a cause contains several amplitudes, m is the largest of their means. The factor is near one for
amplitudes well above 0.3 of the usual size. It has the effect of a prior that vanishes at zero (a non-local prior:
Johnson and Rossell 2010, J. R. Stat. Soc. B 72:143).

The probabilities. The hypotheses are no cause, one cause, and two causes together. Each of the M causes is present with
the prior probability 1 / M, so that its prior odds are 1 to M - 1. The probability of a hypothesis with h causes is
therefore proportional to p(r | H) (M - 1)^-h. Each hypothesis has two versions of equal prior probability. In the first
version, every input has exactly its stated value. In the second version, every input with a stated uncertainty is one
more unknown, with the stated standard deviation (`inference.doubts.stated_inputs`). The probability of a cause is the
sum over all hypotheses that contain it. The probability that the same error is present within its stated uncertainty is
added (`inference.doubts.deviating_inputs`). The probability of `none` is that of the hypotheses without a cause and
without such an error. Causes with nearly the same signature share their probability equally
(`inference.doubts.collinear_causes`).

The computation (`inference.doubts.weighing`). Residuals are described by coefficients of orthonormal polynomials along
each edge, which describe smooth signatures completely. The remainder gives sigma and T. The residuals are linear only
in small amplitudes. The probable hypotheses are therefore simulated at their amplitudes, and the difference from the
linear model is added to r (Gauss-Newton).

Errors of the simulation. Two errors are added to the noise under every hypothesis. The first error remains after the
corrections by better beam models. The second error is 1 per cent of each simulated change of the residuals. Both errors
are assumed smooth along an edge and similar under similar loads, like d.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.doubts.collinear_causes import shared_equally
from eimi_fitting.inference.doubts.deviating_inputs import Deviation, deviations
from eimi_fitting.inference.doubts.possible_causes import PossibleCause
from eimi_fitting.inference.doubts.signatures import About, columns_of
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
    """A possible error of the test bench, with the probability that it has caused the residuals of a fit.

    Parameters
    ----------
    name : str
        Name of the error. ``"none"`` stands for noise and for any error that is not listed.
    probability : float
        Probability that the error is present.
    value : float
        Expected size of the error in ``unit`` if the error is present; zero for ``"none"``.
    unit : str
        Unit of the value; ``"1"`` for a share.
    shift_percent : float
        Change of the initial shear modulus in per cent if the fit is corrected for the error.
    decide_by : str
        The measurement that decides whether the error is present.
    like : tuple of str
        Names of the other errors that would change the residuals in nearly the same way.
    is_within_stated : bool
        Whether the size of the error is at most twice the standard uncertainty that files state for it.
    """

    name: str
    probability: float
    value: float
    unit: str
    shift_percent: float
    decide_by: str
    like: tuple[str, ...] = ()
    is_within_stated: bool = False


@dataclass(frozen=True)
class Weighed:
    """The probabilities of possible errors of the test bench (causes), and the residuals after a correction for them.

    Parameters
    ----------
    causes : tuple of Cause
        The causes, the most probable first.
    in_the_fit : frozenset of str
        Names of the causes that the fit has already corrected, because their sizes were fitted or measured.
    error_mm : dict of str to tuple of ndarray, shape (K,)
        For each cause by name, one array for each experiment: the root mean square residuals in mm under each of K
        loads if the fit were corrected for this cause alone.
    modulus_percent : tuple of float
        Smallest and largest change of the initial shear modulus in per cent if the fit were corrected for one of the
        probable sets of causes.
    most_probable : frozenset of str
        Names of the causes in the most probable set of causes.
    beside_the_fit : float
        Probability that at least one cause is present that the fit has not corrected.
    remaining : tuple of ndarray, shape (K, G, m), or None
        For each experiment, the residuals in mm if the fit were corrected for the most probable set of causes: K loads,
        G = 2 edges (or the coordinates x and y of tracked points), m points. None if the beam model finds no
        equilibrium, or if this correction would not change the fit.
    as_stated : float
        Probability that no cause is present. An error of an input within its stated uncertainty does not count as a
        cause.
    """

    causes: tuple[Cause, ...]
    in_the_fit: frozenset[str]
    error_mm: dict[str, tuple[Array, ...]]
    modulus_percent: tuple[float, float] = (0.0, 0.0)
    most_probable: frozenset[str] = frozenset()
    beside_the_fit: float = 0.0
    remaining: tuple[Array, ...] | None = None
    as_stated: float = 0.0


def weighed_causes(
    problem: Problem,
    optimum: Optimum[Evaluation],
    effects: Sequence[Effect] = (),
    possible: Sequence[PossibleCause] = POSSIBLE_CAUSES,
) -> Weighed:
    """Return how probable each possible error of the test bench (cause) is, given the residuals of a fit.

    Parameters
    ----------
    problem : Problem
        The law, the unknowns and the measurements of the fit.
    optimum : Optimum
        The optimum of the fit.
    effects : sequence of Effect
        The corrections of the fit by better beam models, such as a finer mesh.
    possible : sequence of PossibleCause
        The causes to compare.

    Returns
    -------
    Weighed
        The causes with probabilities of at least 0.001. There are none if no cause changes the residuals, or if the
        beam model finds no equilibrium at the optimum.
    """
    if not possible:
        return Weighed((), frozenset(), {})
    about = About.of(problem, optimum, possible)
    if not about.solved:
        return Weighed((), frozenset(), {})
    columns_by_cause = {cause: columns for cause in possible if (columns := columns_of(about, cause))}
    if not columns_by_cause:
        return Weighed((), frozenset(), {})
    weighing = Weighing(about, effects, stated_columns(about, possible), columns_by_cause)
    posterior = weighing.posterior()
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
    none = float(singly.means[0, 0])
    freed = {nuisance.source for nuisance in problem.unknowns.freed}
    in_the_fit = frozenset(
        cause.name
        for cause, columns in columns_by_cause.items()
        if cause.source in freed or any(column.start for column in columns)
    )
    is_none = np.array([not hypothesis for hypothesis in weighing.hypotheses])
    no_deviation = float(np.prod([1 - one for one in _of_classes(within)]))
    nothing = float(probability[is_none] @ np.where(weighing.is_uncertain, no_deviation, 1.0)[is_none])
    causes, errors = [Cause(NONE, nothing, 0.0, "", 0.0, "")], {}
    for i, cause in enumerate(columns_by_cause):
        alone = singly.means[1 + i]
        errors[cause.name] = weighing.remaining_mm(alone)
        holds = np.array([i in hypothesis for hypothesis in weighing.hypotheses])
        beyond = float(probability[holds].sum())
        without = float(probability[weighing.is_uncertain & ~holds].sum())
        stated = within.get(i)
        total = beyond + without * (stated.probability if stated else 0.0)
        if total < _LEAST:
            continue
        if stated and without * stated.probability > beyond:
            size, moved, members = stated.value, stated.moved, stated.like
        else:
            mean = probability[holds] @ posterior.means[holds] / beyond
            amplitudes = mean[weighing.blocks[i][: weighing.shown(i)]]
            size = float(np.copysign(np.linalg.norm(amplitudes), amplitudes[np.argmax(np.abs(amplitudes))]))
            moved = float(alone[0]) - (none if cause.name in in_the_fit else 0.0)
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


def _of_classes(within: Mapping[int, Deviation]) -> list[float]:
    """Return the probability of each group of wrong inputs that change the residuals alike, such as width and scale."""
    groups = {frozenset({cause, *one.like}) for cause, one in within.items()}
    return [min(sum(within[cause].probability for cause in group), 1.0) for group in groups]


def _most_probable(probability: Array) -> NDArray[np.intp]:
    """Return the indices of the most probable sets of errors, as many as have a total probability of 0.95."""
    order = np.argsort(-probability, kind="stable")
    return order[: int(np.searchsorted(np.cumsum(probability[order]), _PROBABLE)) + 1]
