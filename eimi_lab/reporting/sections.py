"""Choose the section assumption (solid, plane stress, plane strain) with which each fit of a report is simulated."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from eimi_lab.fits.evidence import Evidence, load_evidence
from eimi_lab.fits.fitting import check_section
from eimi_lab.fits.records import FitRecord
from eimi_lab.reporting.shown import ShownFit, sections_of


def evidence_for_fits(
    path: Path, fits: Sequence[ShownFit], flagged: bool
) -> tuple[Evidence, list[tuple[ShownFit, Evidence]]]:
    """Read a dataset as evidence (beam model, loads, edges), once for each section assumption that the fits need.

    A section assumption says how the cross-section is modelled. A bending fit uses the section with which the law was
    fitted to this dataset. If the law was not fitted to this dataset, the common section of the datasets of the fit is
    used. A tensile fit uses the section that all bending fits share. If the bending fits have different sections, the
    section in the specimen file is used.

    Parameters
    ----------
    path : Path
        The dataset.
    fits : sequence of ShownFit
        All fits of the report.
    flagged : bool
        Whether to use states with a flag, which is the name of a defect that a check found.

    Returns
    -------
    shared_evidence : Evidence
        The dataset with the section that all bending fits share or, without such a section, with the section in the
        specimen file.
    evidence_of_fits : list of tuple
        Pairs of a fit and the evidence with the section of this fit.

    Raises
    ------
    InputError
        If the dataset cannot be used.
    """
    sections = {section for shown in fits if isinstance(shown.fit, FitRecord) for section in sections_of(shown.fit)}
    common = sections.pop() if len(sections) == 1 else None
    shared_evidence = load_evidence(path, flagged=flagged, section=check_section(common))
    by_section = {shared_evidence.experiment.model.specimen.section: shared_evidence}
    evidence_of_fits = []
    for shown in fits:
        section = check_section(_section_of(shown, shared_evidence.sha256))
        if section and section not in by_section:
            by_section[section] = load_evidence(path, flagged=flagged, section=section)
        evidence_of_fits.append((shown, by_section[section] if section else shared_evidence))
    return shared_evidence, evidence_of_fits


def _section_of(shown: ShownFit, sha256: str) -> str | None:
    """Return the model of the cross-section with which a fit is simulated on the dataset with this hash.

    Return None for the model that all fits share. This is the case for a tensile fit, and for a fit to other datasets
    with several sections.
    """
    if not isinstance(shown.fit, FitRecord):
        return None
    used = {reference.sha256: reference.section for reference in shown.fit.datasets}
    sections = sections_of(shown.fit)
    return used.get(sha256, sections[0] if len(sections) == 1 else None)
