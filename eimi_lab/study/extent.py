"""How much is studied."""

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
    """What of the evaluation is done.

    states: of each protocol, evenly chosen, None for all; cases: settings of each open question, and seeds of each
    search that is compared, at most; open_questions: whether they are asked.
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
        """The types that validate."""
        return tuple(own for own in self.types if own != TRAINED_ON)

    def chosen(self, count: int) -> NDArray[np.intp]:
        """Which of so many states, the first and the last among them."""
        return np.unique(np.linspace(0, count - 1, min(self.states or count, count)).round().astype(int))


WHOLE = Extent()
QUICK = Extent(materials=("dragon_skin_10",), types=("type1", "type2"), laws=("neo-hookean", "yeoh"), states=6, cases=1)
