"""Read the fits that a report shows, and give each fit a label, a colour, a marker and a line style."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from eimi_fitting.inference.planning.choice_of_law import Choice
from eimi_fitting.time.result import LawOfTime
from eimi_lab.fits.fits_file import read_fits_file
from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.simulated_fit import FittedLaw
from eimi_lab.fits.tensile_record import TensileRecord
from eimi_lab.fits.time_records import RingDownRecord
from eimi_lab.showing.palette import LINES, MARKERS, PALETTE


@dataclass(frozen=True, eq=False)
class ShownFit(FittedLaw):
    """A fit of a report, with its label and its style in figures.

    Attributes
    ----------
    comparison : tuple of Choice
        The comparison of the laws in the same file; empty without a comparison.
    origin : str
        The data to which the law was fitted, such as `bending` or `tensile 50 %`.
    colour, marker : str
        Matplotlib colour and marker of the law.
    line : str or tuple
        Matplotlib line style of the kind of data (`origin`).
    """

    fit: FitRecord | TensileRecord = field(compare=False)
    comparison: tuple[Choice, ...]
    origin: str
    colour: str = PALETTE[0]
    marker: str = MARKERS[0]
    line: Any = LINES[0]

    @property
    def label(self) -> str:
        """Return the law and the data to which it was fitted, such as `yeoh, tensile 50 %`."""
        return f"{self.fit.model}, {self.origin}"


def read_shown(paths: Sequence[Path]) -> tuple[ShownFit, ...]:
    """Read the fits of all files, and give each fit a different label.

    Raises
    ------
    InputError
        If a file is not a fits file.
    """
    read = [(path, read_fits_file(path)) for path in paths]
    bending = [fit for _, file in read for fit in file.fits if isinstance(fit, FitRecord)]
    several = len({section for fit in bending for section in sections_of(fit)}) > 1
    fits = [
        ShownFit(path, index, fit, file.comparison, _origin(fit, several))
        for path, file in read
        for index, fit in enumerate(file.fits)
        if isinstance(fit, FitRecord | TensileRecord)  # a fit of ring-downs alone has a panel of its own
    ]
    for distinction in (lambda s: s.path.name, lambda s: str(s.path), lambda s: f"fit {s.index}"):
        counts = Counter(shown.label for shown in fits)
        fits = [replace(s, origin=f"{s.origin}, {distinction(s)}") if counts[s.label] > 1 else s for s in fits]
    laws = list(dict.fromkeys(shown.fit.model for shown in fits))
    origins = list(dict.fromkeys(shown.origin for shown in fits))
    return tuple(_styled(s, laws.index(s.fit.model), origins.index(s.origin)) for s in fits)


def laws_of_time(paths: Sequence[Path]) -> tuple[tuple[str, LawOfTime], ...]:
    """Return the name and the viscoelastic (Prony) law of each fit that has such a law.

    Raises InputError if a file is not a fits file.
    """
    return tuple(
        (f"{fit.model}, {path.name}", fit.time)
        for path in paths
        for fit in read_fits_file(path).fits
        if isinstance(fit, FitRecord | RingDownRecord) and fit.time is not None
    )


def sections_of(fit: FitRecord) -> tuple[str, ...]:
    """Return the models of the cross-section (such as plane strain) of the datasets of a fit, without repetitions."""
    return tuple(dict.fromkeys(reference.section for reference in fit.datasets))


def chosen(group: Sequence[ShownFit]) -> ShownFit:
    """Return the best of several fits.

    It has the smallest AICc (BIC if AICc is not defined) or, without a comparison of laws, the smallest misfit.
    """
    for shown in group:
        order = {c.model: (np.inf if c.aicc is None else c.aicc, c.bic) for c in shown.comparison}
        if order:
            same_file = [s for s in group if s.path == shown.path]
            return min(same_file, key=lambda s: order[s.fit.model])
    return min(group, key=_misfit)


def leading(fits: Sequence[ShownFit], sha256: str) -> ShownFit | None:
    """Return the best fit to the dataset with the hash ``sha256``, or else the best other fit; None without fits."""
    bending = [shown for shown in fits if isinstance(shown.fit, FitRecord)]
    to_dataset = [s for s in bending if isinstance(s.fit, FitRecord) and sha256 in {d.sha256 for d in s.fit.datasets}]
    group = to_dataset or bending or list(fits)
    return chosen(group) if group else None


def _misfit(shown: ShownFit) -> float:
    return shown.fit.mean_error_mm if isinstance(shown.fit, FitRecord) else shown.fit.rmse_Pa


def _styled(shown: ShownFit, law: int, origin: int) -> ShownFit:
    """Return a copy of a fit with colour and marker number `law` (from 0), and line style number `origin` (from 0)."""
    return replace(
        shown,
        colour=PALETTE[law % len(PALETTE)],
        marker=MARKERS[law % len(MARKERS)],
        line=LINES[origin % len(LINES)],
    )


def _origin(fit: FitRecord | TensileRecord, several_sections: bool) -> str:
    if isinstance(fit, TensileRecord):
        return f"tensile {fit.window()}"
    sections = f", {' and '.join(sections_of(fit))}" if several_sections else ""
    return fit.fitted_to() + sections
