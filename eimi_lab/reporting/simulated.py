"""Fits simulated for a dataset, to be laid over what the camera saw."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from eimi_lab.fits.evidence import Evidence, load_evidence
from eimi_lab.fits.fitting import check_section
from eimi_lab.fits.prediction import Prediction, simulate, simulate_each
from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.validation import Validation
from eimi_lab.process.progress import silent
from eimi_lab.reporting.shown import ShownFit, sections_of


@dataclass(frozen=True)
class SimulatedOutlines(Prediction):
    """One fit on one dataset, its states in the order of the evidence."""

    shown: ShownFit
    evidence: Evidence


@dataclass(frozen=True)
class FitsOnDataset:
    """A dataset as evidence, and all fits in their order: as which evidence each has it, and what is found of it.

    found: None for a fit that is still to be simulated, by itself.
    """

    evidence: Evidence
    every: tuple[ShownFit, ...]
    on: tuple[Evidence, ...]
    found: list[Prediction | None]

    @property
    def validations(self) -> tuple[Validation, ...]:
        """Of all fits that are simulated."""
        return tuple(found.validation for found in self.found if found)

    @property
    def outlines(self) -> tuple[SimulatedOutlines, ...]:
        """The fits that have an equilibrium in all states."""
        return tuple(
            SimulatedOutlines(**vars(found), shown=shown, evidence=evidence)
            for found, shown, evidence in zip(self.found, self.every, self.on, strict=True)
            if found and found.validation.status == "ok"
        )


def simulate_fits(
    path: Path, every: Sequence[ShownFit], flagged: bool, told: Callable[[str], None] = silent
) -> FitsOnDataset:
    """All fits on a dataset, but those that have to be simulated by themselves.

    A fit is simulated under the section under which it took the dataset, or else all of its datasets; a tensile fit
    under the one that all the other fits share, or else the specimen's own. told: hears of each fit that is simulated,
    and of the dataset before. Raises InputError.
    """
    shared = {s for shown in every if isinstance(shown.fit, FitRecord) for s in sections_of(shown.fit)}
    common = shared.pop() if len(shared) == 1 else None
    first = load_evidence(path, flagged=flagged, section=check_section(common))
    told(f"{path.name} read")
    by_section = {first.experiment.model.specimen.section: first}
    on: list[Evidence] = []
    for shown in every:
        section = check_section(_own_section(shown, first.sha256))
        if section and section not in by_section:
            by_section[section] = load_evidence(path, flagged=flagged, section=section)
        on.append(by_section[section] if section else first)
    # Fits that share a section begin with what was found for those before, whatever stands between them.
    simulated = {
        section: simulate_each(own, [(s.path, s.index, s.fit) for s, its in zip(every, on, strict=True) if its is own])
        for section, own in by_section.items()
    }
    every_found: list[Prediction | None] = []
    for shown, evidence in zip(every, on, strict=True):
        found = next(simulated[evidence.experiment.model.specimen.section])
        every_found.append(found.without_correction() if found else None)
        if found:
            told(f"{path.name}, {shown.label}")
    return FitsOnDataset(first, tuple(every), tuple(on), every_found)


def simulate_alone(evidence: Evidence, shown: ShownFit) -> Prediction:
    """A fit that `simulate_fits` has left."""
    return simulate(evidence, shown.fit, shown.path, shown.index, "followed").without_correction()


def _own_section(shown: ShownFit, sha256: str) -> str | None:
    if not isinstance(shown.fit, FitRecord):
        return None
    used = {reference.sha256: reference.section for reference in shown.fit.datasets}
    sections = sections_of(shown.fit)
    return used.get(sha256, sections[0] if len(sections) == 1 else None)
