"""Fits simulated for a dataset, to be laid over what the camera saw."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path

from eimi_lab.dataset.reading import open_dataset
from eimi_lab.errors import InputError
from eimi_lab.fits.evidence import Evidence, load_evidence
from eimi_lab.fits.fitting import check_section
from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.validation import Prediction, Validation, predict_each
from eimi_lab.progress import silent
from eimi_lab.report.shown import ShownFit, sections_of
from eimi_lab.workers import completed


@dataclass(frozen=True)
class SimulatedOutlines(Prediction):
    """One fit on one dataset, its states in the order of the evidence."""

    shown: ShownFit
    evidence: Evidence


_WORTH_A_START = 4  # fits: fewer are simulated on a dataset before another process has started

Simulated = tuple[Evidence, list[SimulatedOutlines], list[Validation]]
"""See `simulate_fits`."""


def simulate_on_each(
    paths: Sequence[Path],
    every: Sequence[ShownFit],
    flagged: bool,
    told: Callable[[str], None] = silent,
    executor: Callable[[], AbstractContextManager[Executor]] | None = None,
    meanwhile: Callable[[], None] | None = None,
) -> Iterator[tuple[int, Simulated]]:
    """`simulate_fits` of each dataset, with its place among the paths, as they come.

    Shared out to the workers of an executor where there is one and fits enough; meanwhile: see `completed`.
    """
    executor = executor if len(every) >= _WORTH_A_START else None

    def arguments(task: int) -> dict[str, object]:
        own = {"path": paths[task], "every": every, "flagged": flagged}
        return own if executor else {**own, "told": told}

    own_of = {(shown.path, shown.index): shown for shown in every}
    tasks = sorted(range(len(paths)), key=lambda task: -_size(paths[task])) if executor else range(len(paths))
    for task, result in completed(simulate_fits, arguments, tasks, executor, (InputError,), meanwhile):
        evidence, simulated, validations = result()
        # A worker sends copies of the fits; whoever looks for those of one fit looks for this one.
        of_these = [
            replace(outlines, shown=own_of[outlines.shown.path, outlines.shown.index]) for outlines in simulated
        ]
        for _ in range(len(every) + 1 if executor else 0):
            told(paths[task].name)
        yield task, (evidence, of_these, validations)


def _size(path: Path) -> float:
    """What a dataset's simulation takes, beside that of others: more states, and a wider beam has more elements.

    The longest is begun first, lest it be waited for in the end. Raises InputError.
    """
    with open_dataset(path) as dataset:
        beam = dataset.specimen.specimen
        return len(dataset.states) * beam.width_mm / beam.length_mm


def simulate_fits(
    path: Path, every: Sequence[ShownFit], flagged: bool, told: Callable[[str], None] = silent
) -> Simulated:
    """A dataset as evidence, the fits that have an equilibrium in all its states, and the validations of all fits.

    A fit is simulated under the section under which it took this dataset, or else all of its datasets; a tensile fit
    under the one that all the other fits share, or else the specimen's own. told: hears of each fit, and of the
    dataset before. Raises InputError.
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
    predicted = {
        section: predict_each(own, [(s.path, s.index, s.fit) for s, its in zip(every, on, strict=True) if its is own])
        for section, own in by_section.items()
    }
    simulated, validations = [], []
    for shown, evidence in zip(every, on, strict=True):
        found = next(predicted[evidence.experiment.model.specimen.section])
        validations.append(found.validation)
        told(f"{path.name}, {shown.label}")
        if found.validation.status == "ok":
            # Without the solid's shapes, which are large, and nothing that is shown.
            simulated.append(SimulatedOutlines(**vars(replace(found, correction=None)), shown=shown, evidence=evidence))
    return first, simulated, validations


def _own_section(shown: ShownFit, sha256: str) -> str | None:
    if not isinstance(shown.fit, FitRecord):
        return None
    used = {reference.sha256: reference.section for reference in shown.fit.datasets}
    sections = sections_of(shown.fit)
    return used.get(sha256, sections[0] if len(sections) == 1 else None)
