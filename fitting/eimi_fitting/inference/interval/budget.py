"""Compute the effect of each uncertain input on the initial shear modulus, and the quantity to measure next."""

# An error of input s of one standard uncertainty changes the fitted unknowns x by d_s. Its effect on the modulus mu(x)
# is
#
#     effect_s = 100 * |mu(x + d_s) - mu(x - d_s)| / (2 mu(x)) per cent.

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.evidence.sources import SOURCES
from eimi_fitting.inference.interval.considered import ConsideredInput, Steps
from eimi_fitting.inference.interval.draws import interval_95, thinned

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BudgetEntry:
    """The effect of one uncertain input, such as the width of the beam, on the initial shear modulus."""

    # Short name of the input, such as "width", and its full name.
    source: str
    words: str
    # In `unit`.
    standard_uncertainty: float
    unit: str
    # Indices of the datasets with this error.
    datasets: tuple[int, ...]
    # Standard deviation of the modulus due to this input alone, in per cent.
    effect_percent: float


@dataclass(frozen=True)
class MeasureNext:
    """The quantity whose better measurement narrows the interval of the modulus most."""

    # Short name of the uncertain input, such as "width"; None for the edges of the beam.
    source: str | None
    # Full name of the quantity, such as "magnetic moment".
    words: str
    # The 95 % interval for half the uncertainty of this quantity.
    initial_shear_modulus_interval_95_Pa: tuple[float, float]


@dataclass(frozen=True)
class Moves:
    """Random samples of the errors of the fitted values, from which the 95 % intervals are computed."""

    # There are n unknowns, scaled to 0..1 between their bounds, S uncertain inputs, and D draws.

    # (n,): fitted values.
    unit: Array
    # (D, n): errors due to noise, priors and the beam models.
    noise: Array
    # (D, S): errors of the inputs, in standard uncertainties.
    deviations: Array
    # The change of the fitted values for one standard uncertainty of each input.
    steps: Steps
    # (D, n): errors due to a probable systematic error; 0 without one.
    further: Array | float = 0.0

    def units(self, of_noise: float = 1.0, of_sources: Array | float = 1.0) -> Array:
        """Return random samples of the unknowns; `of_noise` and `of_sources`: factors on noise and on input errors."""
        # The noise includes the errors due to priors and the beam models. of_sources: (S,) or a number. The result has
        # the shape (D, n).
        moved = of_noise * self.noise + (of_sources * self.deviations) @ self.steps.sizes
        # Factors of 0 also omit the further errors, so that noise, priors and beam models remain.
        return np.clip(self.unit + moved + np.any(of_sources) * (self.steps.without_bounds + self.further), 0.0, 1.0)


def budget(
    sources: Sequence[ConsideredInput], moves: Moves, modulus: Callable[[Array], Array]
) -> tuple[tuple[BudgetEntry, ...], MeasureNext]:
    """Return the effect of each uncertain input on the modulus, and the quantity to measure next."""
    # `modulus` converts sets of unknowns (P, n) to moduli (P,) in Pa.
    entries = budget_entries(sources, moves.unit, moves.steps.sizes, modulus)
    noise = 100 * float(np.std(modulus(moves.units(of_sources=0.0)))) / float(modulus(moves.unit[None])[0])
    if not entries or noise > entries[0].effect_percent:
        return entries, MeasureNext(None, "edges", _interval(modulus(moves.units(of_noise=0.5))))
    first = entries[0]
    is_first = [(s.shared.source, s.shared.datasets) == (first.source, first.datasets) for s in sources]
    halved = np.where(is_first, 0.5, 1.0)
    return entries, MeasureNext(first.source, first.words, _interval(modulus(moves.units(of_sources=halved))))


def budget_entries(
    sources: Sequence[ConsideredInput], unit: Array, sizes: Array, modulus: Callable[[Array], Array]
) -> tuple[BudgetEntry, ...]:
    """Return the effect of each uncertain input on the initial shear modulus, the largest effect first."""
    # unit (n,): fitted values, scaled to 0..1 between their bounds. sizes (S, n): change of `unit` for one standard
    # uncertainty of each of the S inputs. modulus: converts sets of unknowns (P, n) to moduli (P,) in Pa.
    ends = modulus(np.clip(unit + np.concatenate([sizes, -sizes]), 0.0, 1.0))
    effect = 50 * np.abs(np.subtract(*np.split(ends, 2))) / float(modulus(unit[None])[0])
    groups = list(dict.fromkeys(source.shared for source in sources))
    in_group = np.array([[source.shared == group for source in sources] for group in groups]).reshape(
        len(groups), len(sources)
    )
    # The squared effects of the components of an input, such as x and y of the clamp, add up.
    group_effect = np.sqrt((in_group * effect**2).sum(axis=1))
    return tuple(
        BudgetEntry(
            source=groups[g].source,
            words=SOURCES[groups[g].source].words,
            standard_uncertainty=groups[g].standard_uncertainty or 0.0,
            unit=SOURCES[groups[g].source].unit,
            datasets=groups[g].datasets,
            effect_percent=float(group_effect[g]),
        )
        for g in np.argsort(-group_effect, kind="stable")
    )


def _interval(modulus: Array) -> tuple[float, float]:
    return interval_95(modulus[thinned(modulus)])
