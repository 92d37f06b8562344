"""Hyperelastic laws, one module for each law. The dictionary `LAWS` maps the name of a law to the law.

law            the interface `Law` that every law implements, and the types of its arguments and results
neo_hookean    the Neo-Hookean law, one parameter
mooney_rivlin  the Mooney-Rivlin law, two parameters
yeoh           the Yeoh law, three parameters
ogden          the Ogden law with three terms, six parameters
sum_of_terms   a law that is a sum of chosen terms and linear in its coefficients
invariants     base classes for laws that are functions of the invariants I1 and I2
prony          the relaxation of a quasi-linear viscoelastic material
stability      Drucker's stability criterion and the largest stretch up to which a law fulfils it
stable_cells   proof of stability for whole ranges (cells) of stretches, for Ogden's law
known_laws     the dictionary of the laws by their names
search_space   conversion from the unit cube, in which the search moves, to a law's parameters
tensile        engineering stress in uniaxial tension, and the least-squares fit of a tensile test
cards          material cards for finite-element programs
"""

from __future__ import annotations

from eimi_fitting.laws.cards import SOLVERS, Material, material_card
from eimi_fitting.laws.invariants import InvariantLaw
from eimi_fitting.laws.known_laws import KnownLaws, UnknownLaw
from eimi_fitting.laws.law import CannotFit, CardConstants, Coordinate, Law, NotInSolver, PlanarEnergy, Section
from eimi_fitting.laws.mooney_rivlin import MooneyRivlin
from eimi_fitting.laws.neo_hookean import NeoHookean
from eimi_fitting.laws.ogden import Ogden
from eimi_fitting.laws.search_space import SearchSpace, search_space
from eimi_fitting.laws.stability import LARGEST_STRETCH_CHECKED, stable_stretch, stable_up_to
from eimi_fitting.laws.tensile import TensileFit, engineering_stress, fit_tensile
from eimi_fitting.laws.yeoh import Yeoh

LAWS = KnownLaws({law.name: law for law in (NeoHookean(), MooneyRivlin(), Yeoh(), Ogden())})

__all__ = [
    "LARGEST_STRETCH_CHECKED",
    "LAWS",
    "SOLVERS",
    "CannotFit",
    "CardConstants",
    "Coordinate",
    "InvariantLaw",
    "KnownLaws",
    "Law",
    "Material",
    "MooneyRivlin",
    "NeoHookean",
    "NotInSolver",
    "Ogden",
    "PlanarEnergy",
    "SearchSpace",
    "Section",
    "TensileFit",
    "UnknownLaw",
    "Yeoh",
    "engineering_stress",
    "fit_tensile",
    "material_card",
    "search_space",
    "stable_stretch",
    "stable_up_to",
]
