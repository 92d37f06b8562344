"""Between which moduli to search, from the data: steel and gel alike.

Of a stiff beam the displacement is the loads over the modulus: one stiff candidate tells at which moduli the loads
would bend the beam by several times its length, and by next to nothing. Between these the objective is evaluated, the
law's ratios in the middle of their ranges. The search is given three decades about the best, or all that are as good.
No tensile curve has a say in this: one in a wrong unit would lead the search away from the beam.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.equilibrium import Status
from eimi_fitting.inference.evidence.experiment import DISCARDED_MM
from eimi_fitting.inference.evidence.objective import Evaluation, Problem
from eimi_fitting.inference.evidence.unknowns import Unknowns

Array = NDArray[np.float64]

DECADES = 3.0  # of a search; the steps of the polish are made for that range
_FIRST_PA, _STIFFER, _STIFFEST_PA = 1e6, 1e3, 1e18
_LINEAR = 1e-3  # displacement over the beam's length up to which it is the loads over the modulus
_MOST, _LEAST = 3.0, 1e-7  # of the same, if all were linear: beyond it no beam is measured
_A_DECADE = 2  # candidates
_AS_GOOD = 0.02  # share of the best objective
_FINER, _ABOUT = 9, (10**0.5, 10**0.125)  # candidates about the best so far, and how far from it, twice


class NothingConverged(Exception):
    """No candidate could be simulated: loads, geometry or observations do not fit together."""


class NothingActs(Exception):
    """No load bends the specimen in any state, whatever its material."""


@dataclass(frozen=True)
class Scan:
    """moduli (S,) in Pa with objectives (S,) in mm, DISCARDED_MM where a candidate is not valid."""

    moduli_Pa: Array
    objective_mm: Array

    @property
    def best_mm(self) -> float:
        """The least objective."""
        return float(self.objective_mm.min())

    @property
    def best_Pa(self) -> float:
        """Where that is."""
        return float(self.moduli_Pa[np.argmin(self.objective_mm)])

    @property
    def unmoved_mm(self) -> float:
        """The objective of a beam that no load bends."""
        return float(self.objective_mm[-1])

    def searched(self) -> tuple[float, float]:
        """Bounds of a search, Pa."""
        if self.best_mm >= DISCARDED_MM:  # the search will say so
            return float(self.moduli_Pa[0]), float(self.moduli_Pa[-1])
        good = np.log10(self.moduli_Pa[self.objective_mm <= (1 + _AS_GOOD) * self.best_mm])
        middle, half = 0.5 * (good[0] + good[-1]), max(0.5 * (good[-1] - good[0]) + 1 / _A_DECADE, 0.5 * DECADES)
        # Of two digits: no rounding of the objective moves them.
        return float(f"{10 ** (middle - half):.2g}"), float(f"{10 ** (middle + half):.2g}")


def scanned(problem: Problem, independent_points: float) -> Scan:
    """The objective over all moduli at which the loads of the problem's experiments can be told from none.

    Raises NothingActs, NothingConverged.
    """
    compliance = _compliance(problem)
    softest, stiffest = compliance / _MOST, compliance / _LEAST
    moduli = np.geomspace(softest, stiffest, 1 + round(_A_DECADE * np.log10(stiffest / softest)))
    return Scan(moduli, evaluated(problem, moduli, independent_points).objective_mm)


def narrowed(problem: Problem, scan: Scan, independent_points: float) -> Scan:
    """The scan with more candidates about its best, and about the best of these."""
    for factor in _ABOUT:
        moduli = np.geomspace(scan.best_Pa / factor, scan.best_Pa * factor, _FINER)
        errors_mm = evaluated(problem, moduli, independent_points).objective_mm
        order = np.argsort(every := np.concatenate([scan.moduli_Pa, moduli]))
        scan = Scan(every[order], np.concatenate([scan.objective_mm, errors_mm])[order])
    return scan


def within(problem: Problem, bounds_Pa: tuple[float, float]) -> Problem:
    """The problem with its first coordinate searched between these moduli."""
    space = problem.unknowns.space
    low, high = bounds_Pa
    bounded = replace(space, lower=(low, *space.lower[1:]), upper=(high, *space.upper[1:]))
    return replace(problem, unknowns=replace(problem.unknowns, space=bounded))


def evaluated(problem: Problem, moduli_Pa: Array, independent_points: float) -> Evaluation:
    """Candidates of these moduli (S,), the law's ratios in the middle of their ranges."""
    unknowns, unit = _candidates(problem, moduli_Pa)
    return replace(problem, unknowns=unknowns).evaluate(unit, independent_points)


def _candidates(problem: Problem, moduli_Pa: Array) -> tuple[Unknowns, Array]:
    """Their unit coordinates (S, n), and the unknowns that these are of."""
    unit = np.full((len(moduli_Pa), problem.unknowns.searched), 0.5)
    span = (float(moduli_Pa.min()), 2 * float(moduli_Pa.max()))
    unit[:, 0] = np.log(moduli_Pa / span[0]) / np.log(span[1] / span[0])
    unknowns = within(problem, span).unknowns
    return unknowns, unknowns.whole(unit)


def _compliance(problem: Problem) -> float:
    """Modulus (Pa) times the largest displacement over the beam's length, where that is small."""
    modulus = _FIRST_PA
    while modulus <= _STIFFEST_PA:
        bent = _bent(problem, modulus)
        if bent <= _LINEAR:
            if bent == 0:
                raise NothingActs(
                    "no load acts on the specimen in any state: no gravity, no tip force, and no field on a magnet"
                )
            return modulus * bent
        modulus *= _STIFFER
    raise NothingConverged(
        f"even with a shear modulus of {_STIFFEST_PA:g} Pa no beam can be simulated: check geometry, loads and units"
    )


def _bent(problem: Problem, modulus_Pa: float) -> float:
    """The largest displacement over the beam's length, of all states at once: none is far from rest; else infinite."""
    unknowns, unit = _candidates(problem, np.array([modulus_Pa]))
    bent = 0.0
    for experiment in problem.experiments:
        shapes = experiment.model.solve(
            problem.law,
            unknowns.parameters(unit),
            experiment.loads,
            bulk_modulus_Pa=unknowns.bulk_modulus_Pa(unit),
            near=experiment.model.solid.rest(len(experiment.loads)),
        )
        arrived = np.isin(shapes.status, (Status.CONVERGED, Status.UNSTABLE)).all()
        moved = float(np.abs(shapes.displacement).max()) / experiment.model.specimen.length_mm
        bent = max(bent, moved if arrived else np.inf)
    return bent
