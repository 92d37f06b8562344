"""The inputs of a simulation with a fitted law: the bulk modulus, and uncertain inputs such as the magnetic moment."""

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
    """The bulk modulus and the uncertain inputs with which a fitted law is simulated.

    Attributes
    ----------
    bulk_modulus_Pa : ndarray, shape (P,), or None
        Bulk modulus for each of P sets of parameters; None for an incompressible material.
    setup : Setup or None
        Fitted values of the uncertain inputs; None if no input was fitted.
    deviations : mapping of str to ndarray, shape (d,)
        Fitted value minus the value in the input files, for each of the d components of a fitted input, by name.
    """

    bulk_modulus_Pa: Array | None = None
    setup: Setup | None = None
    deviations: Mapping[str, Array] = field(default_factory=dict)

    def applied(self, experiment: Experiment) -> Experiment:
        """Return a copy of an experiment (loads and measurements) with the fitted values of uncertain inputs."""
        return experiment.under(self.deviations)

    def as_measured(self, places_mm: Array) -> Array:
        """Return the places (mm) at which the fitted lens shows simulated points.

        The last axis of the argument and of the result contains x and y.
        """
        return places_mm if self.setup is None else self.setup.imaged(places_mm)

    def compared(self, model: str, parameters: Array, experiment: Experiment, keep: bool = False) -> Comparison:
        """Compare measurements with simulations for P sets of parameters of a law.

        Parameters
        ----------
        model : str
            Name of the law.
        parameters : ndarray, shape (P, n)
            P sets of the n parameters of the law.
        experiment : Experiment
            Beam model, loads and measurements.
        keep : bool
            Whether the result contains the solved shapes of the beam.
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
    """Return a sentence on the error of the modulus due to plane stress or plane strain; None for a solid section."""
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
    """Return a sentence on the measured shape at rest; None if no shape was measured."""
    shape = evidence.rest_shape
    if shape is None:
        return None
    return (
        f"{evidence.path}: the states without load show that the beam at rest has another shape than the specimen "
        f'file says: {shape.in_words}; the fit starts from the measured shape (rest_shape = "straight" in the '
        "specimen file prevents this)"
    )


def compressibility_remark(evidence: Evidence) -> str | None:
    """Return a sentence on the error of the modulus due to assumed incompressibility; None for a small error."""
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

    `candidates` is the number of sets of parameters that are simulated.
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
