"""Fits simulated for a dataset, to be laid over what the camera saw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.materials import LAWS
from eimi_fitting.observation import edge_curves, points_on
from eimi_lab.identification.assumptions import assumptions_of
from eimi_lab.identification.experiments import Evidence, load_evidence
from eimi_lab.identification.fitting import check_section
from eimi_lab.identification.records import FitRecord
from eimi_lab.identification.validation import Validation, validate
from eimi_lab.report.shown import ShownFit, sections_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Simulated:
    """One fit on one dataset, K states in the order of the evidence.

    edges_mm: (K, 2, n, 2) left and right; residuals_mm: (K, 2, m) signed distances of the measured edge points or
    components of tracked points, NaN where nothing was observed; error_mm, deviation_mm: (K,).
    """

    shown: ShownFit
    evidence: Evidence
    validation: Validation
    edges_mm: Array
    residuals_mm: Array
    error_mm: Array
    deviation_mm: Array


def simulate_fits(
    path: Path, every: Sequence[ShownFit], flagged: bool
) -> tuple[Evidence, list[Simulated], list[Validation]]:
    """A dataset as evidence, the fits that have an equilibrium in all its states, and the validations of all fits.

    A fit is simulated under the section under which it took this dataset, or else all of its datasets; a tensile fit
    under the one that all the other fits share, or else the specimen's own. Raises InputError.
    """
    shared = {s for shown in every if isinstance(shown.fit, FitRecord) for s in sections_of(shown.fit)}
    common = shared.pop() if len(shared) == 1 else None
    first = load_evidence(path, flagged=flagged, section=check_section(common))
    by_section = {first.experiment.model.specimen.section: first}
    simulated, validations = [], []
    for shown in every:
        section = check_section(_own_section(shown, first.sha256))
        if section and section not in by_section:
            by_section[section] = load_evidence(path, flagged=flagged, section=section)
        evidence = by_section[section] if section else first
        validations.append(validate(evidence, shown.fit, shown.path, shown.index))
        if validations[-1].status == "ok":
            simulated.append(_simulate(shown, evidence, validations[-1]))
    return first, simulated, validations


def _own_section(shown: ShownFit, sha256: str) -> str | None:
    if not isinstance(shown.fit, FitRecord):
        return None
    used = {reference.sha256: reference.section for reference in shown.fit.datasets}
    sections = sections_of(shown.fit)
    return used.get(sha256, sections[0] if len(sections) == 1 else None)


def _simulate(shown: ShownFit, evidence: Evidence, validation: Validation) -> Simulated:
    experiment = evidence.experiment
    beside = assumptions_of(shown.fit, evidence, 1)
    model = experiment.model.halved()  # what validation.json's errors are of
    shapes = model.solve(
        LAWS[shown.fit.model],
        np.array([shown.fit.values()]),
        experiment.loads,
        bulk_modulus_Pa=beside.bulk_modulus_Pa,
        field_factor=beside.setting.field_factor if beside.setting else None,
    )
    misfit = experiment.observed.misfit(model, shapes, beside.setting)
    return Simulated(
        shown,
        evidence,
        validation,
        beside.as_measured(points_on(edge_curves(model, shapes)[0], 6)),
        np.where(misfit.weights > 0, misfit.residuals[0], np.nan),
        misfit.error_mm[0],
        misfit.deviation_mm[0],
    )
