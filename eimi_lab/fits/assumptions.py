"""What a fit assumes of a dataset beside its law: a bulk modulus that was freed, and nuisances that were.

Freed nuisances belong to the datasets that the fit was made from; on any other everything is as it was stated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.evidence.experiment import Comparison, Experiment, compare
from eimi_fitting.inference.evidence.unknowns import Setup, freed_number
from eimi_fitting.inference.planning.section_bias import expected_bias
from eimi_fitting.laws import LAWS
from eimi_lab.fits.evidence import Evidence
from eimi_lab.fits.records import FitRecord, TensileRecord

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Assumptions:
    """For P candidates: bulk_modulus_Pa (P,), None where incompressible; setup, None where all is as stated."""

    bulk_modulus_Pa: Array | None = None
    setup: Setup | None = None

    def as_measured(self, places_mm: Array) -> Array:
        """Simulated places (..., 2) of the first candidate as the camera has them, with what the camera does put in."""
        return places_mm if self.setup is None else self.setup.imaged(places_mm)

    def compared(self, model: str, parameters: Array, experiment: Experiment, keep: bool = False) -> Comparison:
        """How far P candidates (P, n) of a law are from an experiment; keep: see `compare`."""
        return compare(
            LAWS[model],
            parameters,
            [experiment],
            bulk_modulus_Pa=self.bulk_modulus_Pa,
            setups=[self.setup] if self.setup else None,
            keep=keep,
        )


def section_remark(evidence: Evidence) -> str | None:
    """What the planar section that a dataset is taken under is to be expected to do to a modulus; None for a solid."""
    specimen = evidence.experiment.model.specimen
    if specimen.section == "solid":
        return None
    percent = 100 * expected_bias(specimen)
    return (
        f"{evidence.path}: taken in {specimen.section.replace('-', ' ')}, which is to be expected to make the modulus "
        f"{abs(percent):.0f} % too {'high' if percent > 0 else 'low'} for this specimen; --section solid does not"
    )


def assumptions_of(fit: FitRecord | TensileRecord, evidence: Evidence, candidates: int) -> Assumptions:
    """What the fit assumes of this dataset, the same for all candidates."""
    if not isinstance(fit, FitRecord):
        return Assumptions()
    bulk = None
    if fit.bulk_modulus and evidence.experiment.model.specimen.section == "plane-strain":
        bulk = np.full(candidates, fit.bulk_modulus.value)
    own = [i for i, reference in enumerate(fit.datasets) if reference.sha256 == evidence.sha256]
    if not own or not fit.freed:
        return Assumptions(bulk)
    deviations = ((*freed_number(freed.name), freed.deviation.value) for freed in fit.freed if own[0] in freed.datasets)
    return Assumptions(bulk, Setup.of(deviations, candidates))
