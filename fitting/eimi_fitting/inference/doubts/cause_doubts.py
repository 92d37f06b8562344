"""Name the most probable systematic error in a warning, if it matters for the modulus."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eimi_fitting.inference.doubts.causes import NONE, Cause, Weighed
from eimi_fitting.inference.doubts.checks import OF_NOISE, Doubt, noise_ratio, pairs
from eimi_fitting.inference.doubts.named_error import contains, remaining_error_mm
from eimi_fitting.inference.doubts.table_of_causes import POSSIBLE_CAUSES
from eimi_fitting.inference.evidence.experiment import Comparison, Experiment
from eimi_fitting.inference.evidence.sources import SOURCES
from eimi_fitting.inference.interval.estimate import Estimate

# Largest mean error after a correction for a cause, divided by the mean error of the fit. A correction hardly reduces
# residuals that are noise.
_OF_ERROR = 0.5
_NAMED = 0.1  # a less probable cause is not mentioned as a doubt
_NONE_IMPROBABLE = 0.5
_RIVAL = 0.1  # share of the probability of the first cause
_BOTH = 1.2  # two causes count as present together if the sum of their probabilities is at least this number
_MOST_RIVALS = 2


def cause_doubts(
    weighed: Weighed, estimate: Estimate, final: Comparison, experiments: Sequence[Experiment]
) -> tuple[Doubt, ...]:
    """Name the most probable systematic error in a warning, if it matters for the modulus."""
    if not weighed.causes:
        return ()
    dataset = 0 if len(experiments) == 1 else None
    # No listed cause explains the residuals.
    if weighed.as_stated >= _NONE_IMPROBABLE:
        if not is_as_stated(weighed, experiments) and any(
            noise_ratio(e, m) > OF_NOISE for e, m in pairs(experiments, final)
        ):
            words = "no listed cause and no pair of listed causes explains the residuals"
            return (Doubt(words, dataset, short="the residuals have an unknown cause", kind="cause"),)
        return ()
    # The fit already determines some causes. Causes whose residuals are similar to theirs are left out, because they
    # would explain the same residuals.
    others = [
        cause
        for cause in weighed.causes
        if cause.name != NONE and not cause.is_within_stated and not {cause.name, *cause.like} & set(weighed.in_the_fit)
    ]
    if not others or others[0].probability < _NAMED or not _concerns(others[0], weighed, estimate, final, experiments):
        return ()
    shifts = weighed.modulus_percent
    words = _causes_in_words(others) + _to_free(others[0], experiments)
    return (Doubt(words, dataset, None, None, shifts, _in_short(others, shifts), kind="cause"),)


def is_as_stated(weighed: Weighed, experiments: Sequence[Experiment]) -> bool:
    """Return whether errors of inputs within their uncertainties explain the residuals of a fit."""
    if weighed.as_stated < _NONE_IMPROBABLE or weighed.remaining is None or weighed.most_probable:
        return False
    misfits = (e.observed.of_residuals(r[None]) for e, r in zip(experiments, weighed.remaining, strict=True))
    return all(noise_ratio(e, m) <= OF_NOISE for e, m in zip(experiments, misfits, strict=True))


def _concerns(
    cause: Cause, weighed: Weighed, estimate: Estimate, final: Comparison, experiments: Sequence[Experiment]
) -> bool:
    # The error is named if a correction for it can move the modulus out of its interval. An error whose uncertainty no
    # file states is also named if the correction leaves less than half of the mean error.
    if not contains(estimate.initial_shear_modulus, (cause.shift_percent, *weighed.modulus_percent)):
        return True
    present = [c for c in weighed.causes if c.name in weighed.most_probable - weighed.in_the_fit] or [cause]
    if all(_is_stated(one, experiments) for one in present):
        return False
    remaining = remaining_error_mm(weighed, experiments)
    if remaining is None:
        remaining = float(np.concatenate(weighed.error_mm[cause.name]).mean())
    return remaining < _OF_ERROR * float(final.error_mm[0].mean())


def _is_stated(cause: Cause, experiments: Sequence[Experiment]) -> bool:
    # Whether a file states the uncertainty of this cause or of a similar one.
    possible = {one.name: one.stated_as for one in POSSIBLE_CAUSES}
    sources = {source for name in (cause.name, *cause.like) for source in possible[name]}
    stated = {one.source for experiment in experiments for one in experiment.stated if one.standard_uncertainty}
    return any(stated & {source, *SOURCES[source].covers} for source in sources)


def rivals(causes: Sequence[Cause]) -> tuple[Cause, ...]:
    """Return the systematic errors (at most two) that explain the residuals about as well as the most probable one."""
    first, *others = causes
    alike = [cause for cause in others if cause.name in first.like]
    either = [
        cause
        for cause in others
        if cause.probability > _RIVAL * first.probability and first.probability + cause.probability < _BOTH
    ]
    return tuple(alike or either)[:_MOST_RIVALS]


def _present(causes: Sequence[Cause]) -> Sequence[Cause]:
    # The most probable cause, or the first two if both are likely.
    return causes[:2] if sum(cause.probability for cause in causes[:2]) >= _BOTH else causes[:1]


def _in_short(causes: Sequence[Cause], shifts: tuple[float, float]) -> str:
    possible = {one.name: one.words for one in POSSIBLE_CAUSES}
    others = rivals(causes)
    either = (causes[0], *others) if others else _present(causes)
    names = f" {'or' if others else 'and'} ".join(possible[cause.name] for cause in either)
    least, most = (f"{shift:+.2g}" for shift in shifts)
    change = f"{least} %" if least == most else f"{least} to {most} %"
    return f"{names} would change the modulus by {change}"


def _causes_in_words(causes: Sequence[Cause]) -> str:
    possible = {one.name: one for one in POSSIBLE_CAUSES}
    first = causes[0]

    def described(one: Cause) -> str:
        value = f"{100 * one.value:+.2g} %" if one.unit == "1" else f"{one.value:+.2g} {one.unit}"
        return (
            f"{possible[one.name].words} ({value}, probability {one.probability:.2f}, which would change the modulus "
            f"by {one.shift_percent:+.2g} %)"
        )

    if others := rivals(causes):
        words = f"these causes of the residuals cannot be told apart: {' or '.join(map(described, (first, *others)))}"
    else:
        words = f"the residuals show: {' and '.join(map(described, _present(causes)))}"
    return words + f"; decide by {first.decide_by}"


def _to_free(cause: Cause, experiments: Sequence[Experiment]) -> str:
    # The option that makes the cause an unknown of the fit; empty if there is none, or if it would have no effect.
    source = next(one.source for one in POSSIBLE_CAUSES if one.name == cause.name)
    if not source or (SOURCES[source].lens and any(experiment.view is None for experiment in experiments)):
        return ""
    return f", or free this quantity (--free {source}={abs(cause.value):.1g})"
