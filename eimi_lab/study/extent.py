"""The extent of a study: which materials, specimens, laws, states and strains are evaluated."""

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
    """Which materials, specimens, laws, states and strains a study evaluates.

    Attributes
    ----------
    materials, types, laws : tuple of str
        Keys of the materials, names of the specimens, and names of the fitted laws.
    states : int or None
        Number of states; None for all states.
    windows_percent : tuple
        Largest strains (%) of the fits to tensile curves; None for the whole curve.
    open_questions : bool
        Whether the questions that Di Lecce et al. 2022 leave open are answered.
    cases : int
        Largest number of simulated cases for each of these questions, such as values of the bulk modulus.
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
        """Return the types of specimen to which no law is fitted."""
        return tuple(kind for kind in self.types if kind != TRAINED_ON)

    def chosen(self, count: int) -> NDArray[np.intp]:
        """Return the indices of the evaluated states, evenly spaced among `count` states."""
        return np.unique(np.linspace(0, count - 1, min(self.states or count, count)).round().astype(int))


WHOLE = Extent()
QUICK = Extent(materials=("dragon_skin_10",), types=("type1", "type2"), laws=("neo-hookean", "yeoh"), states=6, cases=1)
