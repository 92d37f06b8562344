"""Compute how an error of each uncertain input, such as the width, changes the residuals of a fit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from eimi_fitting.inference.doubts.possible_causes import PossibleCause, of_source
from eimi_fitting.inference.doubts.signatures import Column, LinearisedFit, signature
from eimi_fitting.inference.evidence.sources import SOURCES
from eimi_fitting.inference.interval.considered import sources_of

Number = tuple[str, int, tuple[int, ...], float]  # source, part, datasets and standard uncertainty


def stated_columns(fit: LinearisedFit, possible: Sequence[PossibleCause]) -> dict[PossibleCause, tuple[Column, ...]]:
    """Compute how an error of each uncertain input, such as the width, changes the residuals of a fit."""
    columns: dict[PossibleCause, tuple[Column, ...]] = {}
    for source, part, datasets, sigma in _numbers(fit, possible):
        start = fit.freed_start(source, part, datasets[0])
        as_cause = of_source(source, source, (1.0,) * len(SOURCES[source].parts), "")
        changes = tuple(
            signature(fit.solved[i], as_cause, part, sigma) if i in datasets else None for i in range(len(fit.solved))
        )
        if fit.is_seen(changes, sigma):
            columns[as_cause] = (*columns.get(as_cause, ()), Column(part, datasets, sigma, start, changes))
    return columns


def _numbers(fit: LinearisedFit, possible: Sequence[PossibleCause]) -> Iterator[Number]:
    experiments = fit.problem.experiments
    for group in sources_of(fit.problem):
        # The model of the fit already contains a measured error.
        if not any(experiments[i].measured.get(group.source) for i in group.datasets):
            for part in range(len(SOURCES[group.source].parts)):
                yield group.source, part, group.datasets, group.standard_uncertainty or 0.0
    # A freed input that is no cause is one of the unknowns of the law.
    of_causes = {cause.source for cause in possible}
    for freed in fit.problem.unknowns.freed:
        if freed.source in of_causes and not any(experiments[i].measured.get(freed.source) for i in freed.datasets):
            yield freed.source, freed.part, freed.datasets, freed.spread
