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
    """Read a dataset once for each section assumption (solid, plane stress, plane strain) that the fits need.

    Parameters
    ----------
    path : Path
        The dataset.
    fits : sequence of ShownFit
        All fits of the report.
    flagged : bool
        Whether to use load steps in which a check found a defect.

    Returns
    -------
    shared_evidence : Evidence
        The dataset with the section assumption that all bending fits share, or else with that of the specimen file.
    evidence_of_fits : list of tuple
        Pairs of a fit and the dataset with the section assumption of this fit.

    Raises
    ------
    InputError
        If the dataset cannot be used.
    """
    # A section assumption (section) says how the cross-section is modelled. The first section that exists in this list
    # is used for a fit:
    #
    # 1. the section with which the law was fitted to this dataset;
    # 2. the section of all other datasets to which the law was fitted, if they have the same section;
    # 3. the section of all bending fits of the report, if they have the same section;
    # 4. the section in the specimen file.
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
    # Return the section assumption (such as plane strain) of a fit for one dataset; None if the fit has none. `sha256`
    # is the hash of the dataset.
    if not isinstance(shown.fit, FitRecord):
        return None
    used = {reference.sha256: reference.section for reference in shown.fit.datasets}
    sections = sections_of(shown.fit)
    return used.get(sha256, sections[0] if len(sections) == 1 else None)
