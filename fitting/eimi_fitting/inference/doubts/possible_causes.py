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
        One entry for each uncertain number that differs from its stated value: the source of the number (a key of
        `SOURCES`), its index among the parts of the source (such as x and y), and its deviation in the unit of the
        source.
    """

    law: Law
    parameters: Array
    bulk_modulus_Pa: Array | None
    experiment: Experiment
    deviations: tuple[tuple[str, int, float], ...] = ()

    @property
    def bent(self) -> Experiment:
        """The experiment with the assumed deviations of specimen, loads and lens.

        A deviation that only multiplies the field by a factor is not included; `setup` contains this factor.
        """
        parts: dict[str, Array] = {}
        for source, part, value in self.deviations:
            if SOURCES[source].bends:
                parts.setdefault(source, np.zeros(len(SOURCES[source].parts)))[part] += value
        return self.experiment.under(parts)

    @property
    def setup(self) -> Setup:
        """How the assumed deviations of inputs change the strength of the field and the picture of the beam."""
        return Setup.of(self.deviations, 1)


Change = Callable[[Assumed, Array], Assumed]


@dataclass(frozen=True)
class PossibleCause:
    """One possible error of a bench, described by one or more amplitudes.

    Attributes
    ----------
    name : str
        Name of the cause in `fits.json`.
    words : str
        Name of the cause for people.
    unit : str
        Unit of the amplitudes; ``"1"`` for a share.
    sizes : tuple of float
        Standard deviation of the prior of each amplitude, the usual size of the error in a laboratory.
    change : callable or None
        Takes the assumptions of a fit and the amplitudes, and returns the assumptions with this cause. None for a
        planar model of a solid section, whose effect is computed with a three-dimensional model.
    decide_by : str
        The measurement that decides whether the cause is present.
    source : str
        The name of the uncertain input whose deviation is the same error, such as "scale" (a key of `SOURCES`); empty
        if there is none.
    parts_of : tuple of str
        Further sources that are parts of the same quantity, such as the coil constant and the remanence for the moment.
    is_common : bool
        Whether all datasets share one amplitude.
    shown : int or None
        Number of amplitudes, from the first, that enter the reported value of the cause. None for all amplitudes.
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
        """The names of the uncertain inputs that are wrong if this cause is present; empty if there is none."""
        return (self.source, *self.parts_of) if self.source else ()


def by_sources(*parts: Mapping[tuple[str, int], float]) -> Change:
    """Return a function that adds deviations of uncertain inputs to the assumptions of a fit.

    The function takes the assumptions and the amplitudes (sizes) of a cause, an error of the bench. ``parts`` has one
    dictionary for each amplitude. A key is an uncertain number: the name of an input (a key of `SOURCES`) and the
    index of the number among the parts of this source. Its value is the deviation of the number for an amplitude of 1.
    Example: with an amplitude of 1 mm for a soft clamp, the beam is 1 mm longer and the clamp lies at x = -1 mm.
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
    """Return the cause ``name`` (a possible error of the bench) that consists of deviations of one uncertain input.

    ``source`` is the name of the input, such as "scale" (a key of `SOURCES`). For ``sizes``, ``decide_by`` and
    ``parts_of``, see `PossibleCause`.
    """
    entry = SOURCES[source]
    parts: list[Mapping[tuple[str, int], float]] = [{(source, i): 1.0} for i in range(len(entry.parts))]
    return PossibleCause(name, entry.words, entry.unit, sizes, by_sources(*parts), decide_by, source, parts_of)
