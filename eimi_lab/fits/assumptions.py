"""The assumptions of a fit for a dataset in addition to its law: a free bulk modulus, and freed nuisances.

Freed nuisances belong to the datasets to which the law was fitted. For any other dataset all inputs are as stated.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.evidence.experiment import Comparison, Experiment, compare
from eimi_fitting.inference.evidence.sources import SOURCES
from eimi_fitting.inference.evidence.unknowns import Setup, freed_number
from eimi_fitting.inference.planning.compressibility import bulk_ratio, compressibility_bias
from eimi_fitting.inference.planning.section_bias import expected_bias
from eimi_fitting.laws import LAWS
from eimi_lab.fits.evidence import Evidence
from eimi_lab.fits.records import FitRecord, TensileRecord
from eimi_lab.fits.time_records import RingDownRecord

Array = NDArray[np.float64]

INCOMPRESSIBLE_FROM = 0.495
"""Poisson's ratio from which the error of an incompressible model is about 0.4 % of the modulus or less."""


@dataclass(frozen=True)
class Assumptions:
    """The assumptions of a fit for P candidates.

    Attributes
    ----------
    bulk_modulus_Pa : ndarray, shape (P,), or None
        None for an incompressible material.
    setup : Setup or None
        The freed nuisances; None if all inputs are as stated.
    deviations : mapping of str to ndarray, shape (parts,)
        Deviations of the freed nuisances that change the specimen, the loads or the lens, by source.
    """

    bulk_modulus_Pa: Array | None = None
    setup: Setup | None = None
    deviations: Mapping[str, Array] = field(default_factory=dict)

    def applied(self, experiment: Experiment) -> Experiment:
        """Return an experiment with the specimen, the loads and the lens of the fit."""
        return experiment.under(self.deviations)

    def as_measured(self, places_mm: Array) -> Array:
        """Map simulated places (..., 2) of the first candidate to the places at which the camera sees them."""
        return places_mm if self.setup is None else self.setup.imaged(places_mm)

    def compared(self, model: str, parameters: Array, experiment: Experiment, keep: bool = False) -> Comparison:
        """Compare P candidates (P, n) of a law with an experiment that `applied` returned; for `keep` see `compare`."""
        return compare(
            LAWS[model],
            parameters,
            [experiment],
            bulk_modulus_Pa=self.bulk_modulus_Pa,
            setups=[self.setup] if self.setup else None,
            keep=keep,
        )


def section_remark(evidence: Evidence) -> str | None:
    """Return a sentence on the expected error of the modulus due to a planar section; None for a solid."""
    specimen = evidence.experiment.model.specimen
    if specimen.section == "solid":
        return None
    percent = 100 * expected_bias(specimen)
    return (
        f"{evidence.path}: fitted in {specimen.section.replace('-', ' ')}; for this specimen the modulus is expected "
        f"to be about {abs(percent):.0f} % too {'high' if percent > 0 else 'low'}; --section solid avoids this"
    )


def rest_shape_remark(evidence: Evidence) -> str | None:
    """Return a sentence on the measured shape at rest; None if the beam has the stated shape."""
    shape = evidence.rest_shape
    if shape is None:
        return None
    return (
        f"{evidence.path}: the states without load show that the beam is not as stated: {shape.in_words} at rest; the "
        'fit begins at this shape (rest_shape = "straight" in the specimen\'s file prevents it)'
    )


def compressibility_remark(evidence: Evidence) -> str | None:
    """Return a sentence on the effect of a stated Poisson's ratio on the modulus; None from a ratio of 0.495."""
    ratio = evidence.poisson_ratio
    if ratio >= INCOMPRESSIBLE_FROM:
        return None
    percent = 100 * compressibility_bias(evidence.experiment.model.specimen, ratio)
    return (
        f"{evidence.path}: poisson_ratio = {ratio:g} is a bulk modulus of {bulk_ratio(ratio):.3g} shear moduli; "
        f"the fit takes the material as incompressible, for which the modulus is about {abs(percent):.1f} % too low"
    )


def assumptions_of(fit: FitRecord | TensileRecord | RingDownRecord, evidence: Evidence, candidates: int) -> Assumptions:
    """Return the assumptions of a fit for a dataset, equal for all candidates."""
    if not isinstance(fit, FitRecord):
        return Assumptions()
    bulk = None
    if fit.bulk_modulus and evidence.experiment.model.specimen.section == "plane-strain":
        bulk = np.full(candidates, fit.bulk_modulus.value)
    places = [i for i, reference in enumerate(fit.datasets) if reference.sha256 == evidence.sha256]
    if not places or not fit.freed:
        return Assumptions(bulk)
    numbers = [(*freed_number(f.name), f.deviation.value) for f in fit.freed if places[0] in f.datasets]
    deviations: dict[str, Array] = {}
    for source, part, value in numbers:
        if SOURCES[source].bends:
            deviations.setdefault(source, np.zeros(len(SOURCES[source].parts)))[part] = value
    return Assumptions(bulk, Setup.of(numbers, candidates), deviations)
