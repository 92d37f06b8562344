"""Estimate the modulus during a run, quickly enough to repeat the estimate after every state.

The law is Neo-Hookean and the section planar; the expected bias of that section (`inference.planning.section_bias`) is
divided out. A fit that starts at the estimate after the previous state needs only a few steps. The complete fit follows
after the run.
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
from eimi_fitting.inference.interval.noise import linearise_noise
from eimi_fitting.inference.planning.section_bias import expected_bias
from eimi_fitting.inference.searching.modulus_range import scanned, within
from eimi_fitting.inference.searching.polish import polish
from eimi_fitting.laws import LAWS
from eimi_fitting.laws.search_space import search_space

Array = NDArray[np.float64]

_LAW = "neo-hookean"
_POINTS_A_STATE = 20.0  # independent points in a state; a guess that only the scan uses


@dataclass(frozen=True)
class ModulusSoFar:
    """The initial shear modulus after the states so far.

    Attributes
    ----------
    value_Pa : float
        The estimate, Pa.
    interval_95_Pa : tuple of float
        Its 95 % interval from noise and stated uncertainties, Pa.
    error_mm : float
        Error of the fit over all states, mm.
    states : int
        Number of states in the fit.
    limited_by : str
        The source with the largest effect on the interval, in words: a stated uncertainty, or the noise of the edges.
    bounds_Pa : tuple of float
        Range of moduli that was searched, Pa; the next estimate uses it again.
    unit : ndarray, shape (1,)
        Place of the optimum in that range, from 0 to 1; the next estimate starts there.
    """

    value_Pa: float
    interval_95_Pa: tuple[float, float]
    error_mm: float
    states: int
    limited_by: str
    bounds_Pa: tuple[float, float]
    unit: Array


def modulus_so_far(
    experiment: Experiment, section_bias: float = 0.0, before: ModulusSoFar | None = None
) -> ModulusSoFar:
    """Fit a Neo-Hookean beam to the states measured so far.

    Parameters
    ----------
    experiment : Experiment
        The states measured so far.
    section_bias : float
        The result of `section_bias_of` for the specimen.
    before : ModulusSoFar, optional
        The estimate after the previous state; the fit starts there.

    Returns
    -------
    ModulusSoFar
        The estimate with its interval.

    Raises
    ------
    NothingActs
        If no load bends the beam.
    NothingConverged
        If no candidate modulus has an equilibrium.
    """
    specimen = experiment.model.specimen
    flat = replace(experiment, model=BeamModel(specimen, plane=specimen.planar_section), solid=None, change=None)
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
    noise = linearise_noise(problem, optimum)
    fitted = estimate(problem, optimum, (), noise, (), 1)
    modulus, first = fitted.initial_shear_modulus, fitted.measure_next
    share = 1.0 / (1.0 + section_bias)
    low_Pa, high_Pa = modulus.interval_95
    return ModulusSoFar(
        value_Pa=share * modulus.value,
        interval_95_Pa=(share * low_Pa, share * high_Pa),
        error_mm=float(optimum.evaluation.objective_mm[0]),
        states=len(flat.loads),
        limited_by="the noise of the edges" if first.source is None else first.words,
        bounds_Pa=bounds,
        unit=np.asarray(optimum.unit)[: problem.unknowns.searched],
    )


def section_bias_of(specimen: Specimen) -> float:
    """Return the expected bias of the planar section during a run; 0 if the specimen itself has a planar section."""
    return expected_bias(specimen) if specimen.section == "solid" else 0.0
