"""Describe a bench error: its usual size, its effect on the assumptions of a fit, and how to confirm it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.sources import SOURCES
from eimi_fitting.inference.evidence.unknowns import Setup
from eimi_fitting.laws.law import Law

Array = NDArray[np.float64]

BOTH_POLARITIES = "the same currents with both polarities (both_polarities = true)"
"""The measurement that decides between several causes in the specimen and in the loads."""


@dataclass(frozen=True)
class Assumed:
    """What a fit assumes about one experiment.

    Parameters
    ----------
    law : Law
        The hyperelastic law.
    parameters : ndarray, shape (1, n)
        The parameters of the law.
    bulk_modulus_Pa : ndarray, shape (1,), or None
        Bulk modulus in Pa; None for an incompressible material.
    experiment : Experiment
        The experiment with a planar beam model.
    deviations : tuple of (str, int, float)
        Name, component (0 for x, 1 for y) and error of each wrong input.
    """

    law: Law
    parameters: Array
    bulk_modulus_Pa: Array | None
    experiment: Experiment
    deviations: tuple[tuple[str, int, float], ...] = ()

    @property
    def with_errors(self) -> Experiment:
        """The experiment with the specimen, the loads and the lens that follow from the errors ``deviations``."""
        parts: dict[str, Array] = {}
        for source, part, value in self.deviations:
            if SOURCES[source].changes_experiment:
                parts.setdefault(source, np.zeros(len(SOURCES[source].parts)))[part] += value
        return self.experiment.under(parts)

    @property
    def setup(self) -> Setup:
        """The changes of the field strength and of the picture that the errors in ``deviations`` cause."""
        return Setup.of(self.deviations, 1)


Change = Callable[[Assumed, Array], Assumed]


@dataclass(frozen=True)
class PossibleCause:
    """One bench error, with one or more components, such as a shift in x and in y.

    Attributes
    ----------
    name : str
        Name of the error in `fits.json`.
    words : str
        Name of the error for people.
    unit : str
        Unit of the components; ``"1"`` for a share.
    sizes : tuple of float
        Usual size (standard deviation) of each component in a laboratory.
    change : callable or None
        Function that adds an error of some size to the assumptions of a fit.
    decide_by : str
        The measurement that decides whether the error is present.
    source : str
        Name of the wrong input, such as "scale"; empty if there is none.
    parts_of : tuple of str
        Names of the inputs with a similar effect, such as the remanence for a wrong moment.
    is_common : bool
        Whether all datasets share the error.
    shown : int or None
        How many components the report gives; None for all.
    """

    name: str
    words: str
    unit: str
    sizes: tuple[float, ...]
    # None for the error of a planar model, which a three-dimensional model computes.
    change: Change | None
    decide_by: str
    source: str = ""
    parts_of: tuple[str, ...] = ()
    is_common: bool = False
    shown: int | None = None

    @property
    def stated_as(self) -> tuple[str, ...]:
        """The names of the inputs whose errors this bench error consists of."""
        return (self.source, *self.parts_of) if self.source else ()


def by_sources(*parts: Mapping[tuple[str, int], float]) -> Change:
    """Return a function that adds a bench error, which consists of errors of inputs, to the assumptions of a fit.

    parts: for each component of the bench error, the errors of the inputs if this component has the size 1. For
    example, ``{("clamp", 0): 1.0}`` is an error of 1 mm in the x of the clamp.
    """

    def change(assumed: Assumed, amplitudes: Array) -> Assumed:
        more = tuple(
            (source, index, float(amplitude * per_unit))
            for part, amplitude in zip(parts, amplitudes, strict=True)
            if amplitude
            for (source, index), per_unit in part.items()
        )
        return replace(assumed, deviations=assumed.deviations + more)

    return change


def of_source(
    name: str, source: str, sizes: tuple[float, ...], decide_by: str, parts_of: tuple[str, ...] = ()
) -> PossibleCause:
    """Return the bench error that consists in one wrong input, such as the scale of the picture.

    The parameters are described in `PossibleCause`.
    """
    entry = SOURCES[source]
    parts: list[Mapping[tuple[str, int], float]] = [{(source, i): 1.0} for i in range(len(entry.parts))]
    return PossibleCause(name, entry.words, entry.unit, sizes, by_sources(*parts), decide_by, source, parts_of)
