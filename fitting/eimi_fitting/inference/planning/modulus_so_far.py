"""The modulus from the states of a run that is still going on: quick enough to follow every state.

A Neo-Hookean solid in a planar section, divided by what that section is expected to make of its modulus
(`inference.planning.section_bias`). Begun from the state before, it takes a few steps; the whole fit comes after the
run.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.model import BeamModel
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.inference.evidence._coarse import coarsened
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.objective import Problem
from eimi_fitting.inference.evidence.unknowns import Unknowns, nuisances
from eimi_fitting.inference.interval.estimate import estimate
from eimi_fitting.inference.planning.section_bias import expected_bias
from eimi_fitting.inference.searching.modulus_range import scanned, within
from eimi_fitting.inference.searching.polish import polish
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.search_space import search_space

Array = NDArray[np.float64]

_LAW = "neo-hookean"
_POINTS_A_STATE = 20.0  # independent ones: a guess for the scan alone


@dataclass(frozen=True)
class ModulusSoFar:
    """The initial shear modulus, Pa, with what noise and stated uncertainties leave of it; error_mm: of all states.

    bounds_Pa, unit: where the next one begins.
    """

    value_Pa: float
    interval_95_Pa: tuple[float, float]
    error_mm: float
    states: int
    bounds_Pa: tuple[float, float]
    unit: Array


def planar(specimen: Specimen) -> Specimen:
    """The specimen in the section that is quick to solve."""
    return replace(specimen, section="plane-stress") if specimen.section == "solid" else specimen


def modulus_so_far(
    experiment: Experiment, section_bias: float = 0.0, before: ModulusSoFar | None = None
) -> ModulusSoFar:
    """Fit the states that there are. section_bias: `expected_bias` of the planar specimen; 0 for one that is meant so.

    Raises NothingActs, NothingConverged.
    """
    flat = replace(experiment, model=BeamModel(planar(experiment.model.specimen)), solid=None, change=None)
    law = LAWS[_LAW]
    problem = Problem(law, Unknowns(search_space(law), nuisances((), 1, [flat.stated])), (flat,), ())
    if before is None:
        scan = scanned(replace(problem, experiments=tuple(coarsened([flat]))), _POINTS_A_STATE * len(flat.loads))
        bounds = scan.searched()
        low, high = np.log(bounds)
        unit = np.array([np.clip((np.log(scan.best_Pa) - low) / (high - low), 0.0, 1.0)])
    else:
        bounds, unit = before.bounds_Pa, before.unit
    problem = within(problem, bounds)
    whole = problem.unknowns.whole(unit)[0]
    optimum = polish(problem.nearby(1.0), whole)
    modulus = estimate(problem, optimum, (), (), 1).initial_shear_modulus
    share = 1.0 / (1.0 + section_bias)
    low_Pa, high_Pa = modulus.interval_95
    return ModulusSoFar(
        value_Pa=share * modulus.value,
        interval_95_Pa=(share * low_Pa, share * high_Pa),
        error_mm=float(optimum.evaluation.objective_mm[0]),
        states=len(flat.loads),
        bounds_Pa=bounds,
        unit=np.asarray(optimum.unit)[: problem.unknowns.searched],
    )


def section_bias_of(specimen: Specimen) -> float:
    """`expected_bias` of the section that is taken here; 0 where the specimen itself is meant to be planar."""
    return expected_bias(planar(specimen)) if specimen.section == "solid" else 0.0
