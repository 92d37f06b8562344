"""What a fit assumes of a dataset beside its law: a bulk modulus that was freed, and nuisances that were.

Freed nuisances belong to the datasets that the fit was made from; on any other everything is as it was stated.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.nuisance import Part, Setting
from eimi_lab.identification.experiments import Evidence
from eimi_lab.identification.records import FitRecord, TensileRecord

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Assumptions:
    """For P candidates: bulk_modulus_Pa (P,), None where incompressible; setting, None where all is as stated."""

    bulk_modulus_Pa: Array | None = None
    setting: Setting | None = None

    def as_measured(self, places_mm: Array) -> Array:
        """Simulated places (..., 2) of the first candidate as the camera has them, with roll and clamp put in."""
        if self.setting is None:
            return places_mm
        angle = np.radians(self.setting.roll_deg[0])
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        return np.asarray(places_mm @ turn + self.setting.clamp_mm[0])


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
    deviations = (
        (part, freed.deviation.value)
        for freed in fit.freed
        for part in get_args(Part)
        if freed.name.startswith(part) and freed.dataset in (None, own[0])
    )
    return Assumptions(bulk, Setting.of(deviations, candidates))
