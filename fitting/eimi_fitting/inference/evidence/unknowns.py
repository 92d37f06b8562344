"""The unknowns of a fit: the parameters of the hyperelastic law, the bulk modulus and uncertain inputs."""

# The unknown of an input is its deviation from the specified value. It has a normal prior with the mean 0 and the
# standard deviation s (Theil and Goldberger 1961, Int. Econ. Rev. 2:65). Each unknown is scaled to a coordinate u from
# 0 to 1; the deviation of an input is 12 s (u - 1/2).

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.evidence.sources import SOURCES, Source, StatedSource
from eimi_fitting.laws.search_space import SearchSpace

Array = NDArray[np.float64]
Rows = NDArray[np.intp]

RANGE = 6.0  # a unit coordinate of a nuisance spans this many standard deviations on either side
_BOUNDS_VARIANCE = 1.0 / 12.0  # of a uniform distribution over the unit interval


@dataclass(frozen=True)
class NuisancePrior:
    """An uncertain input that is fitted together with the law, with the standard deviation of its prior.

    Parameters
    ----------
    kind : str
        Name of the input, such as "width".
    spread : float, optional
        Standard deviation in the unit of the input; by default the standard uncertainty in the files.

    Raises
    ------
    ValueError
        For an unknown name, and for a standard deviation that is not above 0 or is too large for the input.

    Examples
    --------
    >>> NuisancePrior("moment", 0.02)
    NuisancePrior(kind='moment', spread=0.02)
    >>> NuisancePrior("roll", 90.0)
    Traceback (most recent call last):
    ValueError: roll: a standard deviation of 90 should be above 0 and at most 45
    """

    kind: str
    spread: float | None = None

    def __post_init__(self) -> None:
        if self.kind not in SOURCES:
            raise ValueError(f"{self.kind} is no uncertain quantity: choose one of {', '.join(SOURCES)}")
        largest = SOURCES[self.kind].largest
        if self.spread is not None and not 0 < self.spread <= largest:
            raise ValueError(
                f"{self.kind}: a standard deviation of {self.spread:g} should be above 0 and at most {largest:g}"
            )


@dataclass(frozen=True)
class Nuisance:
    """The error of an uncertain input, such as the width, as an unknown of a fit."""

    # Name of the unknown in a result.
    name: str
    # Name of the input, such as "width".
    source: str
    # Index of the component, such as 1 for y.
    part: int
    # Indices of the datasets with this error.
    datasets: tuple[int, ...]
    # Standard deviation of the prior, in the unit of the input.
    spread: float

    @property
    def unit(self) -> str:
        """The unit of the input, such as mm or degrees."""
        return SOURCES[self.source].unit

    def value(self, unit_coordinate: Array) -> Array:
        """Convert a coordinate of the search (0 to 1) into the error of the input."""
        return 2 * RANGE * self.spread * (unit_coordinate - 0.5)


@dataclass(frozen=True)
class Setup:
    """Errors of the field strength and of the camera in one experiment, for several candidate sets of unknowns."""

    # There are P candidates.

    # (P,): factor on the magnetic loads.
    field_factor: Array
    # (P, 2, 2) and (P, 2): the position in the image is `linear` times the true position (x, y), plus `shift_mm`, in
    # mm.
    linear: Array
    shift_mm: Array

    @staticmethod
    def of(deviations: Iterable[tuple[str, int, Array | float]], candidates: int) -> Setup:
        """Compute how errors of inputs change the magnetic loads and the positions in the image."""
        # deviations: name of an input, index of its component (1 for y), and its error for P candidates, (P,).
        values: dict[str, Array] = {}
        for source, part, value in deviations:
            parts = values.setdefault(source, np.zeros((candidates, len(SOURCES[source].parts))))
            parts[:, part] += value
        factor = np.ones(candidates)
        linear, shift = np.tile(np.eye(2), (candidates, 1, 1)), np.zeros((candidates, 2))
        for key, entry in SOURCES.items():
            if key in values and entry.field:
                factor = factor * entry.field(values[key])
            if key in values and entry.image:
                turn, move = entry.image(values[key])
                linear = turn @ linear
                shift = np.einsum("pij,pj->pi", turn, shift) + move
        return Setup(factor, linear, shift)

    def take(self, rows: Rows) -> Setup:
        """Return the errors of field and camera for the candidates with the indices `rows`."""
        return Setup(self.field_factor[rows], self.linear[rows], self.shift_mm[rows])

    def corrected(self, places_mm: Array) -> Array:
        """Return true positions of points from positions in the image."""
        # (P, ..., 2) for P candidates.
        lead = (len(self.shift_mm),) + (1,) * (places_mm.ndim - 1)
        moved = places_mm - self.shift_mm.reshape(*lead, 2)
        return np.einsum("pij,p...j->p...i", np.linalg.inv(self.linear), moved)

    def imaged(self, places_mm: Array) -> Array:
        """Return positions of points in the image from their true positions."""
        # For the first candidate.
        return np.asarray(places_mm @ self.linear[0].T + self.shift_mm[0])


def freed_number(name: str) -> tuple[str, int]:
    """Return input and component of an unknown: ("clamp", 1) for "clamp y of dataset 0", where 1 means y."""
    # Raises KeyError for an unknown name.
    part_name = name.partition(" of dataset")[0]
    return {part: (key, i) for key, source in SOURCES.items() for i, part in enumerate(source.parts)}[part_name]


@dataclass(frozen=True)
class SharedUnknowns:
    """An uncertain input whose error is equal in a group of datasets."""

    source: str
    datasets: tuple[int, ...]
    # In the unit of the input.
    standard_uncertainty: float | None

    def part_name(self, part: int, datasets: int) -> str:
        """Return the name of component `part`, such as "clamp y of datasets 0 and 2"."""
        # `datasets` is the number of datasets of the fit.
        # The name contains no datasets if all of them have the same error.
        name = SOURCES[self.source].parts[part]
        if len(self.datasets) == datasets:
            return name
        *most, last = map(str, self.datasets)
        return f"{name} of datasets {', '.join(most)} and {last}" if most else f"{name} of dataset {last}"


def shared(source: str, stated: Sequence[Sequence[StatedSource]]) -> tuple[SharedUnknowns, ...]:
    """Group the datasets of a fit that share the error of an input, such as all datasets of one coil."""
    # `stated` are the uncertainties that the files of each dataset specify.
    # Datasets whose files specify the same object for the input, such as the same coil, form a group. If the files
    # specify different uncertainties for one object, the largest counts.
    groups: dict[str, list[int]] = {}
    sizes: dict[str, float] = {}
    for index, of_dataset in enumerate(stated):
        entry = next((s for s in of_dataset if s.source == source), None)
        unstated_key = "" if SOURCES[source].common else f"dataset {index}"
        key = f"of {entry.of}" if entry else unstated_key
        groups.setdefault(key, []).append(index)
        if entry:
            sizes[key] = max(sizes.get(key, 0.0), entry.standard_uncertainty)
    return tuple(SharedUnknowns(source, tuple(datasets), sizes.get(key)) for key, datasets in groups.items())


def nuisances(
    priors: Sequence[NuisancePrior], datasets: int, stated: Sequence[Sequence[StatedSource]] | None = None
) -> tuple[Nuisance, ...]:
    """Return the errors of uncertain inputs as unknowns of a fit."""
    # `datasets` is their number, and `stated` are the uncertainties that their files specify. Raises ValueError if an
    # input has no standard deviation above 0.
    freed: list[Nuisance] = []
    for prior in priors:
        for group in shared(prior.kind, stated or [()] * datasets):
            spread = group.standard_uncertainty if prior.spread is None else prior.spread
            if not spread:
                reason = "gives an uncertainty of 0" if spread == 0 else "gives no standard uncertainty"
                raise ValueError(
                    f"{prior.kind}: dataset {group.datasets[0]} {reason}; give a standard deviation above 0"
                )
            freed += [
                Nuisance(group.part_name(part, datasets), prior.kind, part, group.datasets, spread)
                for part in range(len(SOURCES[prior.kind].parts))
            ]
    return tuple(freed)


@dataclass(frozen=True)
class Unknowns:
    """The unknowns of a fit: parameters of the law, the bulk modulus and uncertain inputs."""

    # P sets of values of the n unknowns are an array of shape (P, n), scaled to 0..1.

    # The unknowns of the law and the bulk modulus.
    space: SearchSpace
    # The errors of uncertain inputs, such as the width.
    freed: tuple[Nuisance, ...] = ()

    @property
    def searched(self) -> int:
        """The number of unknowns of the law, with the bulk modulus."""
        return len(self.space.names)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of all unknowns."""
        return (*self.space.names, *(nuisance.name for nuisance in self.freed))

    def modulus_percent(self, moved: float) -> float:
        """Return the change of the modulus in per cent for a change of its scaled value (0 to 1)."""
        return 100 * float(np.expm1(moved * np.log(self.space.upper[0] / self.space.lower[0])))

    @property
    def ratios(self) -> tuple[str, ...]:
        """The names of the fitted inputs that multiply the magnetic load, such as the moment of the magnet."""
        return tuple(nuisance.name for nuisance in self.freed if SOURCES[nuisance.source].field)

    @property
    def prior(self) -> Array:
        """The inverse prior variance of each scaled unknown."""
        # An unknown of the law has the variance of a uniform distribution between the bounds of the search.
        precision = np.full(len(self.names), 1 / _BOUNDS_VARIANCE)
        # the coordinate of an uncertain input covers 2 RANGE prior standard deviations
        precision[self.searched :] = (2 * RANGE) ** 2
        return precision

    def whole(self, unit: Array) -> Array:
        """Append the uncertain inputs, with their nominal values, to scaled unknowns that lack them."""
        unit = np.atleast_2d(unit)
        missing = len(self.names) - unit.shape[1]
        return np.concatenate([unit, np.full((len(unit), missing), 0.5)], axis=1)

    def parameters(self, unit: Array) -> Array:
        """Convert scaled unknowns to parameters of the law."""
        return self.space.parameters(unit[:, : self.searched])

    def bulk_modulus_Pa(self, unit: Array) -> Array | None:
        """Convert scaled unknowns to bulk moduli in Pa."""
        return self.space.bulk_modulus_Pa(unit[:, : self.searched])

    def standardised(self, unit: Array) -> Array:
        """Convert scaled unknowns to deviations of the inputs from their given values, in prior standard deviations."""
        return np.asarray(2 * RANGE * (unit[:, self.searched :] - 0.5))

    def setups(self, unit: Array, datasets: int) -> list[Setup] | None:
        """Convert scaled unknowns to errors of the field strength and of the camera in each dataset."""
        if not self.freed:
            return None
        values = [(n, n.value(unit[:, column])) for column, n in enumerate(self.freed, self.searched)]
        return [
            Setup.of(((n.source, n.part, v) for n, v in values if dataset in n.datasets), len(unit))
            for dataset in range(datasets)
        ]

    def grouped_by_beam(self, unit: Array, datasets: int) -> list[tuple[Rows, list[dict[str, Array]]]]:
        """Group candidates with the same specimen and loads, which are simulated together."""
        # For each group, the result contains the indices of its candidates and, for each dataset, the error of each
        # input, one value per component.
        # One call of the solver simulates a whole group, with a factor on the magnetic loads for each set.
        return self._grouped(unit, datasets, lambda source: source.changes_experiment and source.lens is None)

    def grouped_by_lens(self, unit: Array, datasets: int) -> list[tuple[Rows, list[dict[str, Array]]]]:
        """Group candidates with the same distance and tilt of the lens."""
        # The result has the form of that of `grouped_by_beam`.
        return self._grouped(unit, datasets, lambda source: source.lens is not None)

    def _grouped(
        self, unit: Array, datasets: int, concerns: Callable[[Source], bool]
    ) -> list[tuple[Rows, list[dict[str, Array]]]]:
        columns = [(c, n) for c, n in enumerate(self.freed, self.searched) if concerns(SOURCES[n.source])]
        if not columns:
            return [(np.arange(len(unit)), [{} for _ in range(datasets)])]
        _, first, group = np.unique(unit[:, [c for c, _ in columns]], axis=0, return_index=True, return_inverse=True)
        groups = []
        for g, row in enumerate(first):
            deviations: list[dict[str, Array]] = [{} for _ in range(datasets)]
            for c, n in columns:
                for dataset in n.datasets:
                    parts = deviations[dataset].setdefault(n.source, np.zeros(len(SOURCES[n.source].parts)))
                    parts[n.part] = n.value(unit[row, c])
            groups.append((np.flatnonzero(group.reshape(-1) == g), deviations))
        return groups
