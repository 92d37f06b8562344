"""Fits that start near their optimum and do not diagnose their residuals, so that they are quick."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eimi_fitting.inference.evidence.corrections import polished
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.objective import Problem
from eimi_fitting.inference.evidence.parameter_priors import Prior
from eimi_fitting.inference.evidence.tensile_curves import TensileCurve, TensileEvidence
from eimi_fitting.inference.evidence.unknowns import NuisancePrior, Unknowns, nuisances
from eimi_fitting.inference.interval.corrected_optimum import SearchEnd, refine
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.search_space import search_space


def refined(
    model: str,
    experiments: Sequence[Experiment],
    start_Pa: float,
    *,
    free: Sequence[NuisancePrior] = (),
    tensile: Sequence[TensileCurve] = (),
    priors: Sequence[Prior] = (),
) -> SearchEnd:
    """Return the result of a fit that starts at the modulus `start_Pa`; arguments as in `eimi_fitting.identify`."""
    space = search_space(LAWS[model])
    unit = np.full(len(space.names), 0.5)
    unit[0] = np.log(start_Pa / space.lower[0]) / np.log(space.upper[0] / space.lower[0])
    problem = Problem(
        LAWS[model],
        Unknowns(space, nuisances(free, len(experiments), [experiment.stated for experiment in experiments])),
        tuple(polished(experiment) for experiment in experiments),
        tuple(TensileEvidence.of(curve, model) for curve in tensile),
        tuple(priors),
    )
    return refine(problem, unit, 1)
