"""Describe a systematic error of a measurement, such as a wrong scale: its usual size, and how to confirm it."""

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

# The measurement that decides between several causes in the specimen and in the loads.
BOTH_POLARITIES = "the same currents with both polarities (both_polarities = true)"


@dataclass(frozen=True)
class Assumed:
    """The assumptions of a fit about one experiment: the law, the beam, the loads and the errors of the inputs."""

    law: Law
    # (1, n): the n parameters of the law.
    parameters: Array
    # (1,), or None for an incompressible material.
    bulk_modulus_Pa: Array | None
    # Its beam model is planar.
    experiment: Experiment
    # Name, component (0 for x, 1 for y) and error of each wrong input.
    deviations: tuple[tuple[str, int, float], ...] = ()

    @property
    def with_errors(self) -> Experiment:
        """The experiment, with the assumed errors of specimen, loads and lens added."""
        parts: dict[str, Array] = {}
        for source, part, value in self.deviations:
            if SOURCES[source].changes_experiment:
                parts.setdefault(source, np.zeros(len(SOURCES[source].parts)))[part] += value
        return self.experiment.under(parts)

    @property
    def setup(self) -> Setup:
        """The factor on the magnetic loads, and the shift, rotation and scale of the image, due to wrong inputs."""
        return Setup.of(self.deviations, 1)


Change = Callable[[Assumed, Array], Assumed]


@dataclass(frozen=True)
class PossibleCause:
    """A systematic error that may explain the residuals of a fit, such as a wrong scale of the picture."""

    # Name in fits.json, and name for people.
    name: str
    words: str
    # Unit of the components, such as x and y of a shift; "1" is a share.
    unit: str
    # Usual size (standard deviation) of each component in a laboratory.
    sizes: tuple[float, ...]
    # None for the error of a planar model, which a three-dimensional model computes.
    # Adds an error of some size to the assumptions of a fit.
    change: Change | None
    # The measurement that decides whether the error is present.
    decide_by: str
    # Name of the wrong input, such as "scale"; empty if there is none.
    source: str = ""
    # Names of the inputs with a similar effect, such as the remanence for a wrong moment.
    parts_of: tuple[str, ...] = ()
    # Whether all datasets share the error.
    is_common: bool = False
    # How many components the report gives; None for all.
    shown: int | None = None

    @property
    def stated_as(self) -> tuple[str, ...]:
        """The names of the inputs that can cause this systematic error."""
        return (self.source, *self.parts_of) if self.source else ()


def by_sources(*parts: Mapping[tuple[str, int], float]) -> Change:
    """Return the `Change` for a systematic error whose components are errors of inputs."""
    # For each component of the systematic error, `parts` gives the errors of the inputs at size 1. For example,
    # {("clamp", 0): 1.0} is an error of 1 mm in the x of the clamp.

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
    """Describe the systematic error that one input, such as the scale of the picture, is wrong."""
    entry = SOURCES[source]
    parts: list[Mapping[tuple[str, int], float]] = [{(source, i): 1.0} for i in range(len(entry.parts))]
    return PossibleCause(name, entry.words, entry.unit, sizes, by_sources(*parts), decide_by, source, parts_of)
