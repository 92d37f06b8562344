"""The inputs of a simulation with a fitted law: the bulk modulus, and the uncertain inputs that the fit determined.

An uncertain input (nuisance), such as the magnetic moment, may be fitted together with the law. Its fitted value
applies to the datasets of the fit only. For any other dataset, the inputs have the values in the files of the dataset.
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
from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.tensile_record import TensileRecord
from eimi_lab.fits.time_records import RingDownRecord

Array = NDArray[np.float64]

INCOMPRESSIBLE_FROM = 0.495
"""Smallest Poisson's ratio at which the assumption of incompressibility changes the modulus by 0.4 % or less."""


@dataclass(frozen=True)
class Assumptions:
    """The inputs with which a fitted law is simulated, in addition to its parameters.

    P sets of parameters (candidates) are simulated together.

    Attributes
    ----------
    bulk_modulus_Pa : ndarray, shape (P,), or None
        The bulk modulus of each candidate; None for an incompressible material.
    setup : Setup or None
        The fitted values of the freed nuisances (uncertain inputs that were fitted together with the law); None if no
        input was fitted.
    deviations : mapping of str to ndarray, shape (d,)
        How far the freed nuisances that change the specimen, the loads or the lens deviate from the input files. The
        key is the name of the nuisance. Each has d numbers, such as the two coordinates of a place.
    """

    bulk_modulus_Pa: Array | None = None
    setup: Setup | None = None
    deviations: Mapping[str, Array] = field(default_factory=dict)

    def applied(self, experiment: Experiment) -> Experiment:
        """Return a copy of an experiment in which the uncertain inputs have the values that the fit identified.

        An experiment consists of beam model, loads and measurements. The uncertain inputs (nuisances), such as the
        magnetic moment, are those that were fitted together with the law. They change the specimen, the loads and the
        lens.
        """
        return experiment.under(self.deviations)

    def as_measured(self, places_mm: Array) -> Array:
        """Return where the camera sees simulated points (mm), if the lens has the properties that the fit identified.

        The last axis of the argument and of the result, shape (..., 2), contains x and y in the beam frame. The
        properties of the lens are those of the first candidate (set of parameters).
        """
        return places_mm if self.setup is None else self.setup.imaged(places_mm)

    def compared(self, model: str, parameters: Array, experiment: Experiment, keep: bool = False) -> Comparison:
        """Simulate P candidates (sets of parameters) of a law, and compare them with measurements.

        Parameters
        ----------
        model : str
            Name of the law.
        parameters : ndarray, shape (P, n)
            The n parameters of the law for each candidate.
        experiment : Experiment
            Beam model, loads and measurements, with the fitted values of the uncertain inputs (see `applied`).
        keep : bool
            Whether the result also contains the solved shapes of the beam, from which a later simulation can start.
        """
        return compare(
            LAWS[model],
            parameters,
            [experiment],
            bulk_modulus_Pa=self.bulk_modulus_Pa,
            setups=[self.setup] if self.setup else None,
            keep=keep,
        )


def section_remark(evidence: Evidence) -> str | None:
    """Return a sentence on the error of the modulus due to a planar beam model (plane stress or plane strain).

    Return None for a beam model with a solid cross-section.
    """
    specimen = evidence.experiment.model.specimen
    if specimen.section == "solid":
        return None
    percent = 100 * expected_bias(specimen)
    return (
        f"{evidence.path}: the cross-section is modelled in {specimen.section.replace('-', ' ')}; for this specimen "
        f"the modulus is expected to be about {abs(percent):.0f} % too {'high' if percent > 0 else 'low'}; --section "
        "solid avoids this error"
    )


def rest_shape_remark(evidence: Evidence) -> str | None:
    """Return a sentence on the measured shape at rest; None if the fit uses the shape in the specimen file."""
    shape = evidence.rest_shape
    if shape is None:
        return None
    return (
        f"{evidence.path}: the states without load show that the beam at rest has another shape than the specimen "
        f'file says: {shape.in_words}; the fit starts from the measured shape (rest_shape = "straight" in the '
        "specimen file prevents this)"
    )


def compressibility_remark(evidence: Evidence) -> str | None:
    """Return a sentence on the error of the modulus because the fit takes the material as incompressible.

    The error follows from Poisson's ratio in the specimen file. Return None for a ratio of 0.495 or more.
    """
    ratio = evidence.poisson_ratio
    if ratio >= INCOMPRESSIBLE_FROM:
        return None
    percent = 100 * compressibility_bias(evidence.experiment.model.specimen, ratio)
    return (
        f"{evidence.path}: poisson_ratio = {ratio:g} means a bulk modulus of {bulk_ratio(ratio):.3g} shear moduli; "
        f"the fit takes the material as incompressible, and its modulus is therefore about {abs(percent):.1f} % too "
        "low"
    )


def assumptions_of(fit: FitRecord | TensileRecord | RingDownRecord, evidence: Evidence, candidates: int) -> Assumptions:
    """Return the bulk modulus and the uncertain inputs with which a fitted law is simulated on a dataset.

    The values are repeated for each of the `candidates` sets of parameters that are simulated together.
    """
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
        if SOURCES[source].changes_experiment:
            deviations.setdefault(source, np.zeros(len(SOURCES[source].parts)))[part] = value
    return Assumptions(bulk, Setup.of(numbers, candidates), deviations)
