"""The fits that a report shows: what each is called, and how it is drawn."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from eimi_fitting.inference.planning.choice_of_law import Choice
from eimi_lab.fits.fits_file import read_fits_file
from eimi_lab.fits.records import FitRecord, TensileRecord
from eimi_lab.fits.simulated_fit import FittedLaw
from eimi_lab.showing.palette import LINES, MARKERS, PALETTE


@dataclass(frozen=True, eq=False)
class ShownFit(FittedLaw):
    """One fit of a file; origin says what the law was fitted to.

    comparison: of the laws of its file. A law has its colour and marker, and an origin its line, throughout a report.
    """

    comparison: tuple[Choice, ...]
    origin: str
    colour: str = PALETTE[0]
    marker: str = MARKERS[0]
    line: Any = LINES[0]

    @property
    def label(self) -> str:
        """Law and origin: `yeoh, tensile 50 %`."""
        return f"{self.fit.model}, {self.origin}"


def read_shown(paths: Sequence[Path]) -> tuple[ShownFit, ...]:
    """Every fit of the files, named as far as is needed to tell them apart. Raises InputError."""
    read = [(path, read_fits_file(path)) for path in paths]
    bending = [fit for _, file in read for fit in file.fits if isinstance(fit, FitRecord)]
    several = len({section for fit in bending for section in sections_of(fit)}) > 1
    found = [
        ShownFit(path, index, fit, file.comparison, _origin(fit, several))
        for path, file in read
        for index, fit in enumerate(file.fits)
    ]
    for more in (lambda s: s.path.name, lambda s: str(s.path), lambda s: f"fit {s.index}"):
        alike = Counter(shown.label for shown in found)
        found = [replace(s, origin=f"{s.origin}, {more(s)}") if alike[s.label] > 1 else s for s in found]
    laws = list(dict.fromkeys(shown.fit.model for shown in found))
    origins = list(dict.fromkeys(shown.origin for shown in found))
    return tuple(_drawn(s, laws.index(s.fit.model), origins.index(s.origin)) for s in found)


def sections_of(fit: FitRecord) -> tuple[str, ...]:
    """The section assumptions under which a fit took its datasets, each once."""
    return tuple(dict.fromkeys(reference.section for reference in fit.datasets))


def chosen(group: Sequence[ShownFit]) -> ShownFit:
    """The law of the smallest AICc, or else BIC, in the first file that compares; else the smallest misfit."""
    for shown in group:
        order = {c.model: (np.inf if c.aicc is None else c.aicc, c.bic) for c in shown.comparison}
        if order:
            own = [s for s in group if s.path == shown.path]
            return min(own, key=lambda s: order[s.fit.model])
    return min(group, key=_misfit)


def leading(every: Sequence[ShownFit], sha256: str) -> ShownFit | None:
    """The fit that stands for a dataset: the chosen one of those made from it, or else of all of bending, or of all."""
    bending = [shown for shown in every if isinstance(shown.fit, FitRecord)]
    own = [s for s in bending if isinstance(s.fit, FitRecord) and sha256 in {d.sha256 for d in s.fit.datasets}]
    group = own or bending or list(every)
    return chosen(group) if group else None


def _misfit(shown: ShownFit) -> float:
    return shown.fit.mean_error_mm if isinstance(shown.fit, FitRecord) else shown.fit.rmse_Pa


def _drawn(shown: ShownFit, law: int, origin: int) -> ShownFit:
    return replace(
        shown,
        colour=PALETTE[law % len(PALETTE)],
        marker=MARKERS[law % len(MARKERS)],
        line=LINES[origin % len(LINES)],
    )


def _origin(fit: FitRecord | TensileRecord, several_sections: bool) -> str:
    if isinstance(fit, TensileRecord):
        return f"tensile {fit.window()}"
    words = fit.fitted_to()
    return f"{words}, {' and '.join(sections_of(fit))}" if several_sections else words
