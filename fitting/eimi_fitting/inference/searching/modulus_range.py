"""Determine from the data the range of moduli to search, for any material from gel to steel."""

# The largest displacement of a stiff beam of length L and shear modulus mu is u = c L / mu, with a constant c. The
# objective (the error in mm that the fit minimises) is computed for moduli from c / 3 to c / 1e-7, for which this
# formula gives u / L from 3 to 1e-7. The searched range contains all moduli whose objective is within 2 % of the
# smallest one. It covers at least a factor of 1000.

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.equilibrium import Status
from eimi_fitting.inference.evidence.experiment import DISCARDED_MM
from eimi_fitting.inference.evidence.objective import Evaluation, Problem
from eimi_fitting.inference.evidence.unknowns import Unknowns

Array = NDArray[np.float64]

DECADES = 3.0  # width of the search; the difference steps of the polish are chosen for it
_FIRST_PA, _STIFFER, _STIFFEST_PA = 1e6, 1e3, 1e18  # first stiff candidate, factor to the next one, last one
_LINEAR = 1e-3  # the response is linear up to this displacement over the beam's length
_MOST, _LEAST = 3.0, 1e-7  # range of linear displacements over the beam's length that the scan covers
_PER_DECADE = 2  # candidates of the scan
_AS_GOOD = 0.02  # moduli count as equally good within this share of the best objective
_FINER, _ABOUT = 9, (10**0.5, 10**0.125)  # candidates about the best modulus, and their range, in two rounds


class NothingConverged(Exception):
    """The exception for a beam that could not be simulated with any parameters."""


class NothingActs(Exception):
    """The exception for a specimen that no load bends."""


@dataclass(frozen=True)
class Scan:
    """The error (mm) of a fit for each of several shear moduli."""

    # (S,): the moduli are in ascending order.

    moduli_Pa: Array
    # Very large for a modulus without an equilibrium of the beam, or with an unstable law.
    objective_mm: Array

    @property
    def best_mm(self) -> float:
        """The smallest error in mm."""
        return float(self.objective_mm.min())

    @property
    def best_Pa(self) -> float:
        """The modulus in Pa with the smallest error."""
        return float(self.moduli_Pa[np.argmin(self.objective_mm)])

    @property
    def unmoved_mm(self) -> float:
        """The error in mm for the largest modulus, with which the beam hardly bends."""
        return float(self.objective_mm[-1])

    def searched(self) -> tuple[float, float]:
        """Return the lower and the upper bound of the modulus for the search, in Pa."""
        if self.best_mm >= DISCARDED_MM:  # no candidate is valid; the search reports it
            return float(self.moduli_Pa[0]), float(self.moduli_Pa[-1])
        good = np.log10(self.moduli_Pa[self.objective_mm <= (1 + _AS_GOOD) * self.best_mm])
        middle, half = 0.5 * (good[0] + good[-1]), max(0.5 * (good[-1] - good[0]) + 1 / _PER_DECADE, 0.5 * DECADES)
        # Two digits: rounding errors of the objective do not change the bounds.
        return float(f"{10 ** (middle - half):.2g}"), float(f"{10 ** (middle + half):.2g}")


def scanned(problem: Problem, independent_points: float) -> Scan:
    """Compute the error of a fit for many moduli, from very soft to very stiff."""
    # Raises NothingActs if no load bends the specimen, and NothingConverged if not even the stiffest beam can be
    # simulated.
    compliance = _compliance(problem)
    softest, stiffest = compliance / _MOST, compliance / _LEAST
    moduli = np.geomspace(softest, stiffest, 1 + round(_PER_DECADE * np.log10(stiffest / softest)))
    return Scan(moduli, evaluated(problem, moduli, independent_points).objective_mm)


def narrowed(problem: Problem, scan: Scan, independent_points: float) -> Scan:
    """Add moduli near the best one to the moduli for which the error of a fit was computed."""
    for factor in _ABOUT:
        moduli = np.geomspace(scan.best_Pa / factor, scan.best_Pa * factor, _FINER)
        errors_mm = evaluated(problem, moduli, independent_points).objective_mm
        all_moduli = np.concatenate([scan.moduli_Pa, moduli])
        order = np.argsort(all_moduli)
        scan = Scan(all_moduli[order], np.concatenate([scan.objective_mm, errors_mm])[order])
    return scan


def within(problem: Problem, bounds_Pa: tuple[float, float]) -> Problem:
    """Return the fit with these bounds of the modulus."""
    space = problem.unknowns.space
    low, high = bounds_Pa
    bounded = replace(space, lower=(low, *space.lower[1:]), upper=(high, *space.upper[1:]))
    return replace(problem, unknowns=replace(problem.unknowns, space=bounded))


def evaluated(problem: Problem, moduli_Pa: Array, independent_points: float) -> Evaluation:
    """Return the objective and the residuals of a fit for several shear moduli."""
    unknowns, unit = _candidates(problem, moduli_Pa)
    return replace(problem, unknowns=unknowns).evaluate(unit, independent_points)


def _candidates(problem: Problem, moduli_Pa: Array) -> tuple[Unknowns, Array]:
    # Unknowns with bounds that contain all moduli, and the values of the unknowns for each modulus.
    # The parameters beside the modulus are in the middle of their ranges.
    unit = np.full((len(moduli_Pa), problem.unknowns.searched), 0.5)
    span = (float(moduli_Pa.min()), 2 * float(moduli_Pa.max()))
    unit[:, 0] = np.log(moduli_Pa / span[0]) / np.log(span[1] / span[0])
    unknowns = within(problem, span).unknowns
    return unknowns, unknowns.whole(unit)


def _compliance(problem: Problem) -> float:
    # The constant c (Pa) in u = c L / mu: displacement u of a beam with length L and large shear modulus mu.
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
    # The largest displacement divided by the length; infinite without an equilibrium.
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
        has_converged = np.isin(shapes.status, (Status.CONVERGED, Status.UNSTABLE)).all()
        displacement = float(np.abs(shapes.displacement).max()) / experiment.model.specimen.length_mm
        bent = max(bent, displacement if has_converged else np.inf)
    return bent
