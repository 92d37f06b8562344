"""Describe a possible error of a test bench (a cause of residuals): its usual size, its effect, and how to confirm it.

An error contradicts what a fit assumes about the specimen, the loads, the picture or the law. The effect of an error is
described by a function that changes these assumptions. All causes are listed in `inference.doubts.table_of_causes`.
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
    """What a fit assumes about one experiment: the law, the beam model, the loads, and errors of the inputs.

    Parameters
    ----------
    law : Law
        The hyperelastic law.
    parameters : ndarray, shape (1, n)
        The n parameters of the law.
    bulk_modulus_Pa : ndarray, shape (1,), or None
        Bulk modulus in Pa; None for an incompressible material.
    experiment : Experiment
        The experiment with a planar model, without the ``deviations``.
    deviations : tuple of (str, int, float)
        One element for each number that differs from its stated value: the name of the input, the index of the
        component (0 for x, 1 for y), and the difference in the unit of the input.
    """

    law: Law
    parameters: Array
    bulk_modulus_Pa: Array | None
    experiment: Experiment
    deviations: tuple[tuple[str, int, float], ...] = ()

    @property
    def bent(self) -> Experiment:
        """The experiment, changed by those ``deviations`` that belong to the specimen, the loads or the lens."""
        parts: dict[str, Array] = {}
        for source, part, value in self.deviations:
            if SOURCES[source].bends:
                parts.setdefault(source, np.zeros(len(SOURCES[source].parts)))[part] += value
        return self.experiment.under(parts)

    @property
    def setup(self) -> Setup:
        """The effect of the ``deviations`` on the strength of the field and on the picture of the beam."""
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
        Function of two arguments: the assumptions of a fit, and the numbers. It returns the assumptions with this
        error. None for the error of a planar model, whose effect is computed by a three-dimensional model.
    decide_by : str
        The measurement that decides whether the error is present.
    source : str
        Name of the input that is wrong if the error is present, such as "scale"; empty if there is none.
    parts_of : tuple of str
        Names of further inputs that may be wrong instead, with a similar effect. Example: the remanence, if the error
        is a wrong magnetic moment.
    is_common : bool
        Whether all datasets share one error.
    shown : int or None
        How many of the numbers, counted from the first, are combined to the reported size. None for all.
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
        """The names of all inputs that may be wrong if this error is present; empty if there is none."""
        return (self.source, *self.parts_of) if self.source else ()


def by_sources(*parts: Mapping[tuple[str, int], float]) -> Change:
    """Return a function that changes the assumptions of a fit by errors of inputs, such as a wrong scale.

    The function takes the assumptions, and one number for each dictionary of ``parts``. A key of a dictionary is the
    name of an input and the index of its component, such as ``("clamp", 0)`` for x. The value is the error of this
    input if the number is 1.
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
    """Describe the error of a test bench that consists in one wrong input, such as the scale of the picture.

    ``source`` is the name of the input, ``sizes`` are the usual sizes of its error, and ``parts_of`` are the names of
    further inputs that may be wrong instead.
    """
    entry = SOURCES[source]
    parts: list[Mapping[tuple[str, int], float]] = [{(source, i): 1.0} for i in range(len(entry.parts))]
    return PossibleCause(name, entry.words, entry.unit, sizes, by_sources(*parts), decide_by, source, parts_of)
