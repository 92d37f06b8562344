"""The unknowns of a fit: the law's coordinates, the bulk modulus, and what else is known only so well.

The last are left at what specimen and calibration say, or freed with a normal prior about that: its standard deviation
enters the fit as one more observation (Theil and Goldberger 1961, Int. Econ. Rev. 2:65). What there is stands in
`inference.evidence.sources`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.evidence.sources import SOURCES, StatedSource
from eimi_fitting.laws.search_space import SearchSpace

Array = NDArray[np.float64]
Rows = NDArray[np.intp]

RANGE = 6.0  # standard deviations either way that a unit coordinate spans
_BOUNDS_VARIANCE = 1.0 / 12.0  # of a uniform distribution over the unit interval


@dataclass(frozen=True)
class NuisancePrior:
    """A key of SOURCES that is freed, and the standard deviation of what is known of it, in the source's unit.

    Without a spread it is what the experiments state. Raises ValueError for an unknown key, and for a standard
    deviation that is not above 0 or too large to be meant.

    Examples
    --------
    >>> NuisancePrior("moment", 0.02)
    NuisancePrior(kind='moment', spread=0.02)
    >>> NuisancePrior("roll", 90.0)
    Traceback (most recent call last):
    ValueError: roll: a standard deviation of 90 should be in 0..45
    """

    kind: str
    spread: float | None = None

    def __post_init__(self) -> None:
        if self.kind not in SOURCES:
            raise ValueError(f"{self.kind}: should be one of {', '.join(SOURCES)}")
        largest = SOURCES[self.kind].largest
        if self.spread is not None and not 0 < self.spread <= largest:
            raise ValueError(f"{self.kind}: a standard deviation of {self.spread:g} should be in 0..{largest:g}")


@dataclass(frozen=True)
class Nuisance:
    """One unknown number, a deviation from what was stated; datasets: those that it is of, counted from 0."""

    name: str
    source: str
    part: int
    datasets: tuple[int, ...]
    spread: float

    @property
    def unit(self) -> str:
        """Of its source."""
        return SOURCES[self.source].unit

    def value(self, unit_coordinate: Array) -> Array:
        """From 0..1 to the deviation."""
        return 2 * RANGE * self.spread * (unit_coordinate - 0.5)


@dataclass(frozen=True)
class Setup:
    """What P candidates assume of one dataset.

    field_factor: (P,) on the magnetic loads; linear, shift_mm: (P, 2, 2) and (P, 2), from a place in the beam frame to
    where the camera has it.
    """

    field_factor: Array
    linear: Array
    shift_mm: Array

    @staticmethod
    def of(deviations: Iterable[tuple[str, int, Array | float]], candidates: int) -> Setup:
        """From (source, part, deviation (P,) or a number for all P candidates)."""
        values: dict[str, Array] = {}
        for source, part, value in deviations:
            own = values.setdefault(source, np.zeros((candidates, len(SOURCES[source].parts))))
            own[:, part] += value
        factor = np.ones(candidates)
        linear, shift = np.tile(np.eye(2), (candidates, 1, 1)), np.zeros((candidates, 2))
        for key, found in SOURCES.items():
            if key in values and found.field:
                factor = factor * found.field(values[key])
            if key in values and found.image:
                turn, move = found.image(values[key])
                linear = turn @ linear
                shift = np.einsum("pij,pj->pi", turn, shift) + move
        return Setup(factor, linear, shift)

    def corrected(self, places_mm: Array) -> Array:
        """Measured places (..., 2) as they lie once all that is the camera's is taken out: (P, ..., 2)."""
        lead = (len(self.shift_mm),) + (1,) * (places_mm.ndim - 1)
        moved = places_mm - self.shift_mm.reshape(*lead, 2)
        return np.einsum("pij,p...j->p...i", np.linalg.inv(self.linear), moved)

    def imaged(self, places_mm: Array) -> Array:
        """Places (..., 2) of the first candidate as the camera has them."""
        return np.asarray(places_mm @ self.linear[0].T + self.shift_mm[0])


def freed_number(name: str) -> tuple[str, int]:
    """The source and the part that a freed number of this name in a result is. Raises KeyError for no such part."""
    part = name.partition(" of dataset")[0]
    return {own: (key, i) for key, source in SOURCES.items() for i, own in enumerate(source.parts)}[part]


@dataclass(frozen=True)
class SharedUnknowns:
    """One source, and the datasets that have one error of it in common; uncertainty: None where nobody stated it."""

    source: str
    datasets: tuple[int, ...]
    standard_uncertainty: float | None

    def part_name(self, part: int, datasets: int) -> str:
        """What a number of it is called in a result of so many datasets."""
        own = SOURCES[self.source].parts[part]
        if len(self.datasets) == datasets:
            return own
        *most, last = map(str, self.datasets)
        return f"{own} of datasets {', '.join(most)} and {last}" if most else f"{own} of dataset {last}"


def shared(source: str, stated: Sequence[Sequence[StatedSource]]) -> tuple[SharedUnknowns, ...]:
    """Who has an error of a source in common: datasets that state it of the same thing.

    stated: of each dataset. Where a dataset states nothing, the source itself says whether it is common to all.
    """
    groups: dict[str, list[int]] = {}
    sizes: dict[str, float | None] = {}
    for index, every in enumerate(stated):
        own = next((s for s in every if s.source == source), None)
        nobody = "" if SOURCES[source].common else f"dataset {index}"
        key = f"of {own.of}" if own else nobody
        groups.setdefault(key, []).append(index)
        sizes[key] = own.standard_uncertainty if own else None
    return tuple(SharedUnknowns(source, tuple(datasets), sizes[key]) for key, datasets in groups.items())


def nuisances(
    priors: Sequence[NuisancePrior], datasets: int, stated: Sequence[Sequence[StatedSource]] | None = None
) -> tuple[Nuisance, ...]:
    """The unknown numbers that the priors stand for. Raises ValueError where no standard deviation is known."""
    found: list[Nuisance] = []
    for prior in priors:
        for group in shared(prior.kind, stated or [()] * datasets):
            spread = group.standard_uncertainty if prior.spread is None else prior.spread
            if not spread:
                said = "is exact" if spread == 0 else "states no standard uncertainty"
                raise ValueError(f"{prior.kind}: dataset {group.datasets[0]} {said}, and none is given")
            found += [
                Nuisance(group.part_name(part, datasets), prior.kind, part, group.datasets, spread)
                for part in range(len(SOURCES[prior.kind].parts))
            ]
    return tuple(found)


@dataclass(frozen=True)
class Unknowns:
    """All that a fit finds, as unit coordinates (P, n): the law's first, the bulk modulus, then freed nuisances."""

    space: SearchSpace
    freed: tuple[Nuisance, ...] = ()

    @property
    def searched(self) -> int:
        """How many coordinates the search moves: nuisances stay at what was stated until the polish."""
        return len(self.space.names)

    @property
    def names(self) -> tuple[str, ...]:
        """Of all coordinates."""
        return (*self.space.names, *(nuisance.name for nuisance in self.freed))

    def modulus_percent(self, moved: float) -> float:
        """What a move of the first coordinate, the modulus' logarithm, is of the modulus."""
        return 100 * float(np.expm1(moved * np.log(self.space.upper[0] / self.space.lower[0])))

    @property
    def ratios(self) -> tuple[str, ...]:
        """The nuisances that act on the field, which multiplies as the modulus divides."""
        return tuple(nuisance.name for nuisance in self.freed if SOURCES[nuisance.source].field)

    @property
    def prior(self) -> Array:
        """(n,) inverse variances of what was known before: the bounds of the search, or a nuisance's own prior."""
        precision = np.full(len(self.names), 1 / _BOUNDS_VARIANCE)
        precision[self.searched :] = (2 * RANGE) ** 2
        return precision

    def whole(self, unit: Array) -> Array:
        """(P, searched) or (P, n) -> (P, n)."""
        unit = np.atleast_2d(unit)
        missing = len(self.names) - unit.shape[1]
        return np.concatenate([unit, np.full((len(unit), missing), 0.5)], axis=1)

    def parameters(self, unit: Array) -> Array:
        """(P, n) -> (P, n_p) of the law."""
        return self.space.parameters(unit[:, : self.searched])

    def bulk_modulus_Pa(self, unit: Array) -> Array | None:
        """(P, n) -> (P,), None where it is not freed."""
        return self.space.bulk_modulus_Pa(unit[:, : self.searched])

    def standardised(self, unit: Array) -> Array:
        """(P, n) -> (P, freed): deviations of the nuisances over their standard deviations."""
        return np.asarray(2 * RANGE * (unit[:, self.searched :] - 0.5))

    def setups(self, unit: Array, datasets: int) -> list[Setup] | None:
        """What candidates (P, n) assume of each dataset; None where all is as stated."""
        if not self.freed:
            return None
        values = [(n, n.value(unit[:, column])) for column, n in enumerate(self.freed, self.searched)]
        return [
            Setup.of(((n.source, n.part, v) for n, v in values if dataset in n.datasets), len(unit))
            for dataset in range(datasets)
        ]

    def bent(self, unit: Array, datasets: int) -> list[tuple[Rows, list[dict[str, Array]]]]:
        """Candidates (P, n) in groups that differ in no specimen, load or lens: which, and what deviates (parts,).

        The deviations are those of each dataset, by the source.
        """
        columns = [(c, n) for c, n in enumerate(self.freed, self.searched) if SOURCES[n.source].bends]
        if not columns:
            return [(np.arange(len(unit)), [{} for _ in range(datasets)])]
        _, first, group = np.unique(unit[:, [c for c, _ in columns]], axis=0, return_index=True, return_inverse=True)
        found = []
        for g, row in enumerate(first):
            deviations: list[dict[str, Array]] = [{} for _ in range(datasets)]
            for c, n in columns:
                for dataset in n.datasets:
                    own = deviations[dataset].setdefault(n.source, np.zeros(len(SOURCES[n.source].parts)))
                    own[n.part] = n.value(unit[row, c])
            found.append((np.flatnonzero(group.reshape(-1) == g), deviations))
        return found
