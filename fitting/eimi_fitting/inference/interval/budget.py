"""The budget of an interval: what each stated source does to the initial shear modulus, and what to measure better."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.evidence.sources import SOURCES
from eimi_fitting.inference.interval.considered import ConsideredSources, Steps
from eimi_fitting.inference.interval.draws import interval_95, thinned

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BudgetEntry:
    """One source: how uncertain it was stated, of which datasets, and the standard deviation that gives the modulus."""

    source: str
    words: str
    standard_uncertainty: float
    unit: str
    datasets: tuple[int, ...]
    effect_percent: float


@dataclass(frozen=True)
class MeasureNext:
    """What to measure better next: a source, or None for the edges themselves.

    initial_shear_modulus_interval_95_Pa: what its interval would be with half of that uncertainty.
    """

    source: str | None
    words: str
    initial_shear_modulus_interval_95_Pa: tuple[float, float]


@dataclass(frozen=True)
class Moves:
    """What moves the optimum ``unit`` (n,) in each of D draws.

    noise: (D, n); deviations: (D, S) of the sources, in standard uncertainties; steps: what these do.
    """

    unit: Array
    noise: Array
    deviations: Array
    steps: Steps

    def units(self, of_noise: float = 1.0, of_sources: Array | float = 1.0) -> Array:
        """(D, n) unknowns, with some share of the noise and of each source (S,)."""
        moved = of_noise * self.noise + (of_sources * self.deviations) @ self.steps.sizes
        return np.clip(self.unit + moved + np.any(of_sources) * self.steps.held, 0.0, 1.0)


def budget(
    sources: Sequence[ConsideredSources], moves: Moves, modulus: Callable[[Array], Array]
) -> tuple[tuple[BudgetEntry, ...], MeasureNext]:
    """The entries, largest first, and what to measure next; modulus: of unknowns (P, n)."""
    here = float(modulus(moves.unit[None])[0])
    sizes = moves.steps.sizes
    ends = modulus(np.clip(moves.unit + np.concatenate([sizes, -sizes]), 0.0, 1.0))
    effect = 50 * np.abs(np.subtract(*np.split(ends, 2))) / here
    groups = list(dict.fromkeys(source.shared for source in sources))
    own = np.array([[source.shared == group for source in sources] for group in groups]).reshape(
        len(groups), len(sources)
    )
    together = np.sqrt((own * effect**2).sum(axis=1))
    order = np.argsort(-together, kind="stable")
    entries = tuple(
        BudgetEntry(
            source=groups[g].source,
            words=SOURCES[groups[g].source].words,
            standard_uncertainty=groups[g].standard_uncertainty or 0.0,
            unit=SOURCES[groups[g].source].unit,
            datasets=groups[g].datasets,
            effect_percent=float(together[g]),
        )
        for g in order
    )
    noise = 100 * float(np.std(modulus(moves.units(of_sources=0.0)))) / here
    if not entries or noise > entries[0].effect_percent:
        return entries, MeasureNext(None, "edges", _interval(modulus(moves.units(of_noise=0.5))))
    halved = np.where(own[order[0]], 0.5, 1.0)
    return entries, MeasureNext(entries[0].source, entries[0].words, _interval(modulus(moves.units(of_sources=halved))))


def _interval(modulus: Array) -> tuple[float, float]:
    return interval_95(modulus[thinned(modulus)])
