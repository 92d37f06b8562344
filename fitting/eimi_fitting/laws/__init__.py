"""Hyperelastic laws: one file a law holds all of it, and `LAWS` has them by name.

law               what every law gives: energy, stability, bounds of a search, tensile fit, constants of cards
neo_hookean, mooney_rivlin, yeoh, ogden
sum_of_terms      a law of any of several terms, in which it is linear
invariants        what laws in I1 and I2 have in common
stability         Drucker's criterion; stable_cells proves it, cell by cell, for an energy such as Ogden's
search_space      a law's coordinates between 0 and 1, with the bulk modulus or without
tensile           engineering stress, and least squares on a tensile test
cards             what a material card of each program looks like

A law from elsewhere joins by ``LAWS[law.name] = law``.
"""

from __future__ import annotations

from eimi_fitting.laws.cards import SOLVERS, Material, material_card
from eimi_fitting.laws.invariants import InvariantLaw
from eimi_fitting.laws.law import CannotFit, CardConstants, Coordinate, Law, NotInSolver, PlanarEnergy, Section
from eimi_fitting.laws.mooney_rivlin import MooneyRivlin
from eimi_fitting.laws.neo_hookean import NeoHookean
from eimi_fitting.laws.ogden import Ogden
from eimi_fitting.laws.search_space import SearchSpace, search_space
from eimi_fitting.laws.stability import LARGEST_STRETCH_CHECKED, stable_stretch, stable_up_to
from eimi_fitting.laws.tensile import TensileFit, engineering_stress, fit_tensile
from eimi_fitting.laws.yeoh import Yeoh

LAWS: dict[str, Law] = {law.name: law for law in (NeoHookean(), MooneyRivlin(), Yeoh(), Ogden())}

__all__ = [
    "LARGEST_STRETCH_CHECKED",
    "LAWS",
    "SOLVERS",
    "CannotFit",
    "CardConstants",
    "Coordinate",
    "InvariantLaw",
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
    "Yeoh",
    "engineering_stress",
    "fit_tensile",
    "material_card",
    "search_space",
    "stable_stretch",
    "stable_up_to",
]
