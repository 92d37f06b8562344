"""Describe a possible error of a bench: usual size, effect on the residuals, and the measurement that confirms it.

Such an error is a possible cause of residuals. A cause changes the assumptions of a fit about an experiment: the
specimen, the loads, the picture or the law. The change of the residuals at the optimum is the signature of the cause
(`inference.doubts.causes`). `inference.doubts.table_of_causes` lists the causes.
"""

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
    """The law, the beam model, the loads and the deviations of inputs that a fit assumes for one experiment.

    Parameters
    ----------
    law : Law
        The hyperelastic law.
    parameters : ndarray, shape (1, n)
        The n parameters of the law.
    bulk_modulus_Pa : ndarray, shape (1,), or None
        Bulk modulus in Pa; None for an incompressible material.
    experiment : Experiment
        The experiment with a planar model.
    deviations : tuple of (str, int, float)
        Each number that differs from its stated value: the name of the input, the index of the number (0 for x, 1 for
        y), and the deviation in the unit of the input.
    """

    law: Law
    parameters: Array
    bulk_modulus_Pa: Array | None
    experiment: Experiment
    deviations: tuple[tuple[str, int, float], ...] = ()

    @property
    def bent(self) -> Experiment:
        """The experiment with the assumed deviations of specimen, loads and lens."""
        parts: dict[str, Array] = {}
        for source, part, value in self.deviations:
            if SOURCES[source].bends:
                parts.setdefault(source, np.zeros(len(SOURCES[source].parts)))[part] += value
        return self.experiment.under(parts)

    @property
    def setup(self) -> Setup:
        """The effect of the assumed deviations of inputs on the field strength and on the picture of the beam."""
        return Setup.of(self.deviations, 1)


Change = Callable[[Assumed, Array], Assumed]


@dataclass(frozen=True)
class PossibleCause:
    """One possible error of a test bench, described by one or more numbers, such as a shift in x and in y.

    Attributes
    ----------
    name : str
        Name of the error in `fits.json`.
    words : str
        Name of the error for people.
    unit : str
        Unit of the numbers; ``"1"`` for a share.
    sizes : tuple of float
        Usual size of each number in a laboratory, as a standard deviation.
    change : callable or None
        Takes the assumptions of a fit and the numbers, and returns the assumptions with this error. None for the error
        of a planar model, which a three-dimensional model gives.
    decide_by : str
        The measurement that decides whether the error is present.
    source : str
        Name of the uncertain input whose deviation is the same error, such as "scale"; empty if there is none.
    parts_of : tuple of str
        Names of further inputs that are parts of the same quantity, such as the coil constant for the moment.
    is_common : bool
        Whether all datasets share one error.
    shown : int or None
        How many of the numbers, from the first, enter the reported size. None for all.
    """

    name: str
    words: str
    unit: str
    sizes: tuple[float, ...]
    change: Change | None
    decide_by: str
    source: str = ""
    parts_of: tuple[str, ...] = ()
    is_common: bool = False
    shown: int | None = None

    @property
    def stated_as(self) -> tuple[str, ...]:
        """The names of the inputs that are wrong if this error is present; empty if there is none."""
        return (self.source, *self.parts_of) if self.source else ()


def by_sources(*parts: Mapping[tuple[str, int], float]) -> Change:
    """Return a function that adds deviations of uncertain inputs to the assumptions of a fit.

    Each dictionary of ``parts`` has the deviations for an error of the size 1. A key is the name of an input with the
    index of the number, such as ``("clamp", 0)`` for x.
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
    """Return a possible error of the test bench that is a deviation of one uncertain input.

    ``source`` is the name of the input, such as "scale", and ``sizes`` are the usual sizes of the deviation.
    """
    entry = SOURCES[source]
    parts: list[Mapping[tuple[str, int], float]] = [{(source, i): 1.0} for i in range(len(entry.parts))]
    return PossibleCause(name, entry.words, entry.unit, sizes, by_sources(*parts), decide_by, source, parts_of)
