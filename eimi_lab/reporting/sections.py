"""The section assumption under which a report takes a dataset for each of its fits."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from eimi_lab.fits.evidence import Evidence, load_evidence
from eimi_lab.fits.fitting import check_section
from eimi_lab.fits.records import FitRecord
from eimi_lab.reporting.shown import ShownFit, sections_of


def evidence_for_fits(
    path: Path, every: Sequence[ShownFit], flagged: bool
) -> tuple[Evidence, list[tuple[ShownFit, Evidence]]]:
    """Return a dataset as evidence, and every fit with the evidence as which it takes the dataset.

    A fit is simulated under the section under which it took the dataset, or else all of its datasets; a tensile fit
    under the one that all the other fits share, or else the specimen's own. Raises InputError.
    """
    shared = {section for shown in every if isinstance(shown.fit, FitRecord) for section in sections_of(shown.fit)}
    common = shared.pop() if len(shared) == 1 else None
    first = load_evidence(path, flagged=flagged, section=check_section(common))
    by_section = {first.experiment.model.specimen.section: first}
    fits = []
    for shown in every:
        section = check_section(_own_section(shown, first.sha256))
        if section and section not in by_section:
            by_section[section] = load_evidence(path, flagged=flagged, section=section)
        fits.append((shown, by_section[section] if section else first))
    return first, fits


def _own_section(shown: ShownFit, sha256: str) -> str | None:
    if not isinstance(shown.fit, FitRecord):
        return None
    used = {reference.sha256: reference.section for reference in shown.fit.datasets}
    sections = sections_of(shown.fit)
    return used.get(sha256, sections[0] if len(sections) == 1 else None)
