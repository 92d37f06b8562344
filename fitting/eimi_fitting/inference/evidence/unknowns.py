"""The unknowns of a fit: the coordinates of the hyperelastic law, the bulk modulus and the freed nuisances.

A nuisance is an uncertain number of specimen, calibration or rig (`inference.evidence.sources`). A nuisance either
keeps its stated value or is freed (the fit determines it). A freed nuisance has a normal prior about the stated value,
which enters the fit as one more observation (Theil and Goldberger 1961, Int. Econ. Rev. 2:65). Each unknown has a unit
coordinate u from 0 to 1. A nuisance with the prior standard deviation s deviates by 12 s (u - 1/2) from its stated
value: the values u = 0 and u = 1 are 6 standard deviations (the constant `RANGE`) below and above the stated value.
"""

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
    """A source of uncertainty that a fit frees, with the standard deviation of its prior.

    A source is an uncertain input, such as the moment of the magnet. A fit determines a freed source with the law.

    Parameters
    ----------
    kind : str
        Name of the uncertain input, such as "width" (a key of `SOURCES`).
    spread : float, optional
        Standard deviation in the unit of the source; the stated standard uncertainty by default.

    Raises
    ------
    ValueError
        For an unknown key, and for a standard deviation that is not above 0 or is above ``Source.largest``.

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
    """One freed number of a fit: the deviation of an input from its stated value, determined together with the law.

    Parameters
    ----------
    name : str
        Name of the number in a result.
    source : str
        Name of the uncertain input, such as "width" (a key of `SOURCES`).
    part : int
        Index of the number among the parts of its source.
    datasets : tuple of int
        Indices of the datasets that share the number, counted from 0.
    spread : float
        Standard deviation of the prior of the number, in the unit of the source.
    """

    name: str
    source: str
    part: int
    datasets: tuple[int, ...]
    spread: float

    @property
    def unit(self) -> str:
        """The unit of the deviation of this uncertain input, such as mm or degrees."""
        return SOURCES[self.source].unit

    def value(self, unit_coordinate: Array) -> Array:
        """Return the deviation of the input from its stated value for a unit coordinate from 0 to 1.

        The deviation has the unit of the source. The unit coordinate 1/2 gives the deviation 0.
        """
        return 2 * RANGE * self.spread * (unit_coordinate - 0.5)


@dataclass(frozen=True)
class Setup:
    """How the strength of the field and the picture of the beam differ from their stated values, for P candidates.

    A candidate is one set of values of the unknowns of a fit. The candidates may assume different errors of the inputs,
    such as a wrong coil constant or a shifted camera. A setup belongs to one dataset.

    Parameters
    ----------
    field_factor : ndarray, shape (P,)
        Factor on the magnetic loads; 1 for the stated field.
    linear, shift_mm : ndarray, shape (P, 2, 2) and (P, 2)
        Map from a true position in the beam frame to the position in the picture: the true position times ``linear``,
        plus ``shift_mm``.
    """

    field_factor: Array
    linear: Array
    shift_mm: Array

    @staticmethod
    def of(deviations: Iterable[tuple[str, int, Array | float]], candidates: int) -> Setup:
        """Return the effect of given deviations of the inputs on the field and on the picture.

        Parameters
        ----------
        deviations : iterable of (str, int, ndarray or float)
            For each uncertain number, the key of its source, its index among the parts of the source, and its deviation
            in the unit of the source. A deviation has shape (P,) or is one number for all candidates.
        candidates : int
            The number P of candidates (sets of values of the unknowns).

        Returns
        -------
        Setup
            The factor on the field, and the map from true positions to positions in the picture. Deviations that change
            neither of them are ignored.
        """
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
        """Return the effects on field and picture (the setup) of the sets of unknowns with the indices ``rows``."""
        return Setup(self.field_factor[rows], self.linear[rows], self.shift_mm[rows])

    def corrected(self, places_mm: Array) -> Array:
        """Return true positions (x, y) in mm from positions in the picture, shape (..., 2).

        The result has the shape (P, ..., 2). The P candidates (sets of values of the unknowns) may assume different
        positions of the camera.
        """
        lead = (len(self.shift_mm),) + (1,) * (places_mm.ndim - 1)
        moved = places_mm - self.shift_mm.reshape(*lead, 2)
        return np.einsum("pij,p...j->p...i", np.linalg.inv(self.linear), moved)

    def imaged(self, places_mm: Array) -> Array:
        """Return where the camera shows true positions, (..., 2) in mm, for the first candidate (set of unknowns)."""
        return np.asarray(places_mm @ self.linear[0].T + self.shift_mm[0])


def freed_number(name: str) -> tuple[str, int]:
    """Return the key in `SOURCES` and the index of the part that belong to a name in a result.

    The name is the name of a freed number: an uncertain input, or a part of it such as its x component, that the fit
    determined. It may end with datasets, as in "... of dataset 1".

    Raises
    ------
    KeyError
        For an unknown name.
    """
    part_name = name.partition(" of dataset")[0]
    return {part: (key, i) for key, source in SOURCES.items() for i, part in enumerate(source.parts)}[part_name]


@dataclass(frozen=True)
class SharedUnknowns:
    """A source of uncertainty (an uncertain input), and a group of datasets that share one error of this source.

    Parameters
    ----------
    source : str
        Name of the uncertain input, such as "width" (a key of `SOURCES`).
    datasets : tuple of int
        Indices of the datasets, counted from 0.
    standard_uncertainty : float or None
        Standard uncertainty in the unit of the source; None if no experiment states it.
    """

    source: str
    datasets: tuple[int, ...]
    standard_uncertainty: float | None

    def part_name(self, part: int, datasets: int) -> str:
        """Return the name of one part (such as x or y) of the uncertain input in a result.

        ``datasets`` is the number of datasets of the fit. If the error is not common to all of them, the name ends with
        the datasets that share it, as in "... of datasets 0 and 2".
        """
        name = SOURCES[self.source].parts[part]
        if len(self.datasets) == datasets:
            return name
        *most, last = map(str, self.datasets)
        return f"{name} of datasets {', '.join(most)} and {last}" if most else f"{name} of dataset {last}"


def shared(source: str, stated: Sequence[Sequence[StatedSource]]) -> tuple[SharedUnknowns, ...]:
    """Divide the datasets of a fit into groups; an uncertain input has the same error in all datasets of a group.

    Parameters
    ----------
    source : str
        Name of the uncertain input, such as "width" (a key of `SOURCES`).
    stated : sequence of sequence of StatedSource
        For each dataset, the uncertain inputs that its files state.

    Returns
    -------
    tuple of SharedUnknowns
        One element for each group. Datasets that name the same object in ``StatedSource.of``, such as the same coil,
        form a group. Datasets that do not state the uncertainty of the input form one group if ``Source.common`` is
        true; otherwise each of them is a group.
    """
    groups: dict[str, list[int]] = {}
    sizes: dict[str, float | None] = {}
    for index, of_dataset in enumerate(stated):
        entry = next((s for s in of_dataset if s.source == source), None)
        unstated_key = "" if SOURCES[source].common else f"dataset {index}"
        key = f"of {entry.of}" if entry else unstated_key
        groups.setdefault(key, []).append(index)
        sizes[key] = entry.standard_uncertainty if entry else None
    return tuple(SharedUnknowns(source, tuple(datasets), sizes[key]) for key, datasets in groups.items())


def nuisances(
    priors: Sequence[NuisancePrior], datasets: int, stated: Sequence[Sequence[StatedSource]] | None = None
) -> tuple[Nuisance, ...]:
    """Return the freed numbers of a fit: the uncertain inputs that the fit determines together with the law.

    Parameters
    ----------
    priors : sequence of NuisancePrior
        The sources of uncertainty that the fit determines, with their prior standard deviations.
    datasets : int
        Number of datasets.
    stated : sequence of sequence of StatedSource, optional
        The stated sources of each dataset; none by default.

    Returns
    -------
    tuple of Nuisance
        The numbers of all sources. A source has one number for each of its parts, such as x and y of the clamp. A
        group of datasets that share an error of the source has its own numbers.

    Raises
    ------
    ValueError
        If a prior has no standard deviation, and a dataset gives no uncertainty of the source or an uncertainty of 0.
    """
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
    """The unknowns of a fit: coordinates of the law, then the bulk modulus if it is searched, then freed nuisances.

    Each of the n unknowns has a unit coordinate from 0 to 1. P candidates (sets of values of the unknowns) have the
    shape (P, n).

    Parameters
    ----------
    space : SearchSpace
        The coordinates of the law and, if it is searched, of the bulk modulus.
    freed : tuple of Nuisance
        The freed nuisances: uncertain inputs that the fit determines together with the law.
    """

    space: SearchSpace
    freed: tuple[Nuisance, ...] = ()

    @property
    def searched(self) -> int:
        """Number of coordinates that the search varies: coordinates of the law, and the bulk modulus if it is unknown.

        The inputs that the fit determines too (freed nuisances) keep their stated values until the Gauss-Newton steps.
        """
        return len(self.space.names)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of all unknowns, in the order of their coordinates."""
        return (*self.space.names, *(nuisance.name for nuisance in self.freed))

    def modulus_percent(self, moved: float) -> float:
        """Return the change of the modulus in per cent if the first unit coordinate changes by ``moved``.

        The first coordinate increases linearly with the logarithm of the modulus, from 0 to 1 between its bounds.
        """
        return 100 * float(np.expm1(moved * np.log(self.space.upper[0] / self.space.lower[0])))

    @property
    def ratios(self) -> tuple[str, ...]:
        """Names of the freed nuisances (inputs that the fit determines) that scale the magnetic load.

        Without priors the data determine only the ratio of magnetic load to modulus.
        """
        return tuple(nuisance.name for nuisance in self.freed if SOURCES[nuisance.source].field)

    @property
    def prior(self) -> Array:
        """The inverse of the prior variance of each of the n unit coordinates, shape (n,).

        A coordinate of the law or of the bulk modulus has the variance of a uniform distribution from 0 to 1, which is
        1/12. The coordinate of a freed nuisance (an uncertain input that the fit determines) covers 12 prior standard
        deviations, so that its variance is 1/144.
        """
        precision = np.full(len(self.names), 1 / _BOUNDS_VARIANCE)
        precision[self.searched :] = (2 * RANGE) ** 2
        return precision

    def whole(self, unit: Array) -> Array:
        """Return all n unit coordinates (0 to 1) of P candidates, (P, n), also if only the searched ones are given.

        A candidate is one set of values of the unknowns. ``unit`` has the shape (P, n), or (P, `searched`) without the
        coordinates of the nuisances (uncertain inputs). The missing coordinates are those of the stated values, 1/2.
        """
        unit = np.atleast_2d(unit)
        missing = len(self.names) - unit.shape[1]
        return np.concatenate([unit, np.full((len(unit), missing), 0.5)], axis=1)

    def parameters(self, unit: Array) -> Array:
        """Return the m parameters of the law for P candidates, shape (P, m).

        A candidate is one set of values of the unknowns. ``unit`` has its n unit coordinates (0 to 1), shape (P, n).
        """
        return self.space.parameters(unit[:, : self.searched])

    def bulk_modulus_Pa(self, unit: Array) -> Array | None:
        """Return the bulk moduli of P candidates in Pa, (P,); None if the bulk modulus is not searched.

        A candidate is one set of values of the unknowns. ``unit`` has its n unit coordinates (0 to 1), shape (P, n).
        """
        return self.space.bulk_modulus_Pa(unit[:, : self.searched])

    def standardised(self, unit: Array) -> Array:
        """Return the deviations of the f freed inputs from their stated values, in prior standard deviations, (P, f).

        A freed input is an uncertain input that the fit determines together with the law. P candidates (sets of values
        of the unknowns) have n unit coordinates (0 to 1) each: ``unit``, shape (P, n).
        """
        return np.asarray(2 * RANGE * (unit[:, self.searched :] - 0.5))

    def setups(self, unit: Array, datasets: int) -> list[Setup] | None:
        """Return the effect of freed inputs on field and picture in each dataset; None if the fit frees no input.

        A freed input is an uncertain input that the fit determines together with the law. If it differs from its stated
        value, the field may be stronger or weaker, or the picture may be shifted and rotated. The result has one
        `Setup` for each dataset, with these effects for P candidates. ``unit`` has the n unit coordinates (0 to 1) of
        each candidate, shape (P, n).
        """
        if not self.freed:
            return None
        values = [(n, n.value(unit[:, column])) for column, n in enumerate(self.freed, self.searched)]
        return [
            Setup.of(((n.source, n.part, v) for n, v in values if dataset in n.datasets), len(unit))
            for dataset in range(datasets)
        ]

    def bent(self, unit: Array, datasets: int) -> list[tuple[Rows, list[dict[str, Array]]]]:
        """Group the candidates (sets of values of the unknowns) that have the same specimen and the same loads.

        Their beams bend alike if their laws agree, and each group can be solved with one beam model. Candidates differ
        in the specimen or in the loads if the fit determines such an input, for example the width.

        Parameters
        ----------
        unit : ndarray, shape (P, n)
            P candidates in unit coordinates (0 to 1).
        datasets : int
            Number of datasets.

        Returns
        -------
        list of (ndarray, list of dict)
            For each group, the indices of its candidates, and one dictionary for each dataset. The dictionary has the
            deviations of the inputs that the fit determines: the key is the name of an input (a key of `SOURCES`), the
            value an array with the deviation of each part (such as x and y), shape (parts,).
        """
        return self._grouped(unit, datasets, lambda source: source.bends and source.lens is None)

    def seen(self, unit: Array, datasets: int) -> list[tuple[Rows, list[dict[str, Array]]]]:
        """Group the candidates (sets of values of the unknowns) that are seen through the same lens.

        Candidates differ in the lens if the fit determines a property of it, such as its distance from the beam.

        Parameters
        ----------
        unit : ndarray, shape (P, n)
            P candidates in unit coordinates (0 to 1).
        datasets : int
            Number of datasets.

        Returns
        -------
        list of (ndarray, list of dict)
            For each group, the indices of its candidates, and one dictionary for each dataset. The dictionary has the
            deviations of the lens from its stated values: the key is the name of a property of the lens (a key of
            `SOURCES`), the value an array with the deviation of each part, shape (parts,).
        """
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
