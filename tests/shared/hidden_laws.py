"""Draw hyperelastic laws at random as sums of one to three terms, and simulate measurements of these laws."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.beside import SolidBeside
from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.outline import outline, points_on
from eimi_fitting.beam.specimen import Section
from eimi_fitting.discovery.bending_rows import NoEquilibrium
from eimi_fitting.discovery.terms_of_a_law import LIBRARY, LOT, MOST_TERMS
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.tensile_curves import TensileCurve
from eimi_fitting.laws import engineering_stress
from eimi_fitting.laws.sum_of_terms import SumOfTerms, Term
from eimi_lab.config.specimen import load_specimen
from eimi_lab.study.observed import NOISE_MM, experiment_of

Array = NDArray[np.float64]
STRAIN = np.linspace(0.02, 3.0, 150)
MODULUS_PA = (15e3, 60e3)
LEAST_SHARE = 0.15
STATES, FIELD_PER_PA = 6, 7.05 / 46e3  # mT per Pa: bends type 1 as far as the shipped protocols do
PLANAR_MESH, SOLID_MESH = (70, 8), (26, 3, 1)


@cache
def beam(kind: str, solid: bool) -> BeamModel | SolidBeside:
    """Return the (planar or solid) beam model of an example specimen such as "type1"."""
    section: Section = "solid" if solid else "plane-stress"
    specimen = replace(load_specimen(kind).mechanics(), section=section)
    return SolidBeside(specimen, *SOLID_MESH) if solid else BeamModel(specimen, *PLANAR_MESH)


@dataclass(frozen=True)
class Hidden:
    """A random law: k terms and their coefficients (Pa), shape (k,)."""

    terms: tuple[Term, ...]
    coefficients: Array

    @staticmethod
    def drawn(rng: np.random.Generator, off: float = 1.0) -> Hidden:
        """Return a random law with random terms, coefficients and shear modulus.

        off : largest factor by which a constant Jm, b or alpha differs from the library of terms
        """
        while True:
            chosen = rng.choice(len(LIBRARY), rng.integers(1, MOST_TERMS + 1), replace=False)
            terms = tuple(LIBRARY[i] for i in sorted(chosen))
            if any(term.has_modulus for term in terms):
                break
        while (shares := rng.dirichlet(np.ones(len(terms)))).min() < LEAST_SHARE:
            pass
        if off > 1:
            terms = tuple(_elsewhere(term, off, rng) for term in terms)
        law = SumOfTerms(terms)
        coefficients = shares / engineering_stress(law, np.eye(len(terms)), STRAIN[-1:])[:, 0]
        modulus = np.exp(rng.uniform(*np.log(MODULUS_PA)))
        return Hidden(terms, coefficients * modulus / law.initial_shear_modulus(coefficients))

    @property
    def modulus_Pa(self) -> float:
        """Initial shear modulus (Pa) of the law."""
        return float(SumOfTerms(self.terms).initial_shear_modulus(self.coefficients))

    def curve(self, noise: float, rng: np.random.Generator) -> TensileCurve:
        """Return a simulated tensile test; `noise` is relative to the largest stress."""
        stress = engineering_stress(SumOfTerms(self.terms), self.coefficients, STRAIN)
        return TensileCurve(STRAIN, stress + rng.normal(0.0, noise * stress.max(), len(STRAIN)))

    def bent(self, solid: bool, rng: np.random.Generator) -> Experiment:
        """Return a simulated experiment with a planar beam or a solid one; raise NoEquilibrium if there is none."""
        kind = f"type{rng.integers(1, 4)}"
        model, stiffness = beam(kind, solid), 1 + LOT * rng.normal()
        fields = np.linspace(0.0, FIELD_PER_PA * self.modulus_Pa, STATES)
        coefficients = stiffness * self.coefficients[None]
        shapes = model.solve(SumOfTerms(self.terms), coefficients, Loads.along(fields), tolerance_mm=1e-3)
        if not shapes.converged.all():
            raise NoEquilibrium
        edges = points_on(outline(model, shapes)[0], 2)[:, :, 4:-2]
        edges = edges[:, :, :: max(edges.shape[2] // 60, 1)]
        return experiment_of(kind, edges + rng.normal(0.0, NOISE_MM, edges.shape), fields, model.specimen.section)


def _elsewhere(term: Term, off: float, rng: np.random.Generator) -> Term:
    """Return a term whose constant (Jm, b or alpha) is changed by a random factor of at most `off`."""
    shift = np.exp(rng.uniform(-1, 1) * np.log(off))
    if term.number is None:
        return term
    return replace(term, number=term.number * (max(shift, 1 / shift) if term.kind == "gent" else shift))
