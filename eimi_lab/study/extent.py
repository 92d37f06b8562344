"""Choose which part of the evaluation is done."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.specimen import Section

LAWS_STUDIED = ("neo-hookean", "mooney-rivlin", "yeoh", "ogden")
SECTIONS: tuple[Section, ...] = ("plane-strain", "solid")
TRAINED_ON = "type1"


@dataclass(frozen=True)
class Extent:
    """The part of the evaluation that is done.

    Attributes
    ----------
    materials, types, laws : tuple of str
    states : int or None
        Number of states of each protocol, evenly chosen; None for all.
    windows_percent : tuple
        Largest strains of the windows of tensile curves in per cent; None for the whole curve.
    open_questions : bool
        Whether the open questions are answered.
    cases : int
        Largest number of settings of an open question, and of seeds of an optimiser.
    """

    materials: tuple[str, ...] = ("dragon_skin_10", "ecoflex_00_50")
    types: tuple[str, ...] = ("type1", "type2", "type3", "type4")
    laws: tuple[str, ...] = LAWS_STUDIED
    states: int | None = None
    windows_percent: tuple[float | None, ...] = (20.0, 50.0, 100.0, None)
    open_questions: bool = True
    cases: int = 5

    @property
    def unseen(self) -> tuple[str, ...]:
        """Return the types on which the laws are validated."""
        return tuple(kind for kind in self.types if kind != TRAINED_ON)

    def chosen(self, count: int) -> NDArray[np.intp]:
        """Return the indices of the chosen states among `count`, including the first and the last."""
        return np.unique(np.linspace(0, count - 1, min(self.states or count, count)).round().astype(int))


WHOLE = Extent()
QUICK = Extent(materials=("dragon_skin_10",), types=("type1", "type2"), laws=("neo-hookean", "yeoh"), states=6, cases=1)
