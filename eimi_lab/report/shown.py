"""The fits that a report shows: what each is called, and its colour."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from eimi_lab.identification.fits import read_any_fits
from eimi_lab.identification.records import FitRecord, TensileRecord

# Okabe and Ito's palette, told apart by readers with any colour vision (jfly.uni-koeln.de/color, 2008).
_PALETTE = ("#0072B2", "#D55E00", "#009E73", "#E69F00", "#CC79A7", "#56B4E9", "#000000", "#F0E442")


@dataclass(frozen=True)
class ShownFit:
    """One fit of a file; origin says what the law was fitted to, and the same origin has the same colour throughout."""

    path: Path
    index: int
    fit: FitRecord | TensileRecord
    origin: str
    colour: str

    @property
    def label(self) -> str:
        """Law and origin: `yeoh, tensile 50 %`."""
        return f"{self.fit.model}, {self.origin}"


def read_shown(paths: Sequence[Path]) -> tuple[ShownFit, ...]:
    """Every fit of the files, named as far as is needed to tell them apart. Raises InputError."""
    read = [(path, index, fit) for path in paths for index, fit in enumerate(read_any_fits(path))]
    sections = {section for _, _, fit in read if isinstance(fit, FitRecord) for section in sections_of(fit)}
    found = [ShownFit(path, index, fit, _origin(fit, len(sections) > 1), "") for path, index, fit in read]
    for more in (lambda s: s.path.name, lambda s: f"fit {s.index}"):
        alike = Counter(shown.label for shown in found)
        found = [replace(s, origin=f"{s.origin}, {more(s)}") if alike[s.label] > 1 else s for s in found]
    origins = list(dict.fromkeys(shown.origin for shown in found))
    return tuple(replace(s, colour=_PALETTE[origins.index(s.origin) % len(_PALETTE)]) for s in found)


def sections_of(fit: FitRecord) -> tuple[str, ...]:
    """The section assumptions under which a fit took its datasets, each once."""
    return tuple(dict.fromkeys(reference.section for reference in fit.datasets))


def _origin(fit: FitRecord | TensileRecord, several_sections: bool) -> str:
    if isinstance(fit, TensileRecord):
        return f"tensile {fit.window()}"
    words = fit.fitted_to()
    return f"{words}, {' and '.join(sections_of(fit))}" if several_sections else words
