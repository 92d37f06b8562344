"""Choose the load cases to measure next, so that they distinguish two laws.

The second law is fitted to edges that are simulated with the first. The sum of the squared residuals in units of the
noise variance is the expected difference in AIC (T-optimality: Atkinson and Fedorov 1975, Biometrika 62:57).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.loads import Loads
from eimi_fitting.beam.specimen import Specimen
from eimi_fitting.inference.evidence.experiment import compare
from eimi_fitting.inference.evidence.objective import Problem
from eimi_fitting.inference.evidence.sources import StatedSource
from eimi_fitting.inference.interval.considered import considered
from eimi_fitting.inference.planning.design_of_experiment import (
    Choice,
    EdgeNoise,
    KnownLaw,
    experiment_without_noise,
    planar_model,
    slopes_of,
    states_reached,
    weight_of_point,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Rivals:
    """The load cases from which a plan chooses those that distinguish two laws.

    The second law and the uncertain inputs are fitted to edges that are simulated with the first law.

    Attributes
    ----------
    loads : Loads
        The S load cases.
    states : ndarray of int, shape (S,)
        Index of each load case in the list of all possible load cases.
    square : ndarray, shape (S,)
        Sum of the squared residuals at the start of the fit, divided by the noise variance.
    score : ndarray, shape (S, m)
        Gradient of half of ``square`` by the m unknowns of the fit.
    normal : ndarray, shape (S, m, m)
        Hessian of half of ``square``.
    prior : ndarray, shape (m, m)
        Inverse prior covariance of the unknowns.
    """

    loads: Loads
    states: Choice
    square: Array
    score: Array
    normal: Array
    prior: Array

    def __len__(self) -> int:
        return len(self.square)

    def variance(self, choices: Choice) -> Array:
        """Return 1 / (expected difference in AIC of two laws) for each choice of load cases; a plan minimises it."""
        square, score = self.square[choices].sum(axis=1), self.score[choices].sum(axis=1)
        step = np.linalg.solve(self.normal[choices].sum(axis=1) + self.prior, score[..., None])[..., 0]
        return np.asarray(1 / np.maximum(square - np.einsum("di,di->d", score, step), 1e-12))

    def apart(self, choice: Choice) -> float:
        """Return the expected difference in AIC of two laws for the chosen load cases."""
        return 1 / float(self.variance(choice[None])[0])


def rivals(
    known: KnownLaw,
    rival: KnownLaw,
    specimen: Specimen,
    loads: Loads,
    stated: Sequence[StatedSource],
    noise: EdgeNoise,
) -> Rivals:
    """Compute how well each load case distinguishes two laws.

    Parameters
    ----------
    known, rival : KnownLaw
        The law that is assumed to be true, and the second law.
    specimen : Specimen
        The specimen of the planned run.
    loads : Loads
        The possible load cases.
    stated : sequence of StatedSource
        Uncertain inputs.
    noise : EdgeNoise
        Noise of the edges.

    Raises
    ------
    ValueError
        If no load case has an equilibrium under both laws.
    """
    model = planar_model(specimen)
    states = states_reached(rival, model, loads)
    states = states[states_reached(known, model, loads.take(states))]
    experiment = experiment_without_noise(known, model, loads.take(states), stated, noise)
    unknowns, unit = rival.unknowns()
    problem = Problem(rival.law, unknowns, (experiment,))
    slopes = slopes_of(problem, unit)
    residuals = compare(rival.law, rival.parameters[None], [experiment]).misfits[0].residuals[0]
    moved = [change for source in considered(problem, unit) if (change := source.changes[0]) is not None]
    every = np.concatenate([slopes, np.array(moved).reshape(len(moved), *slopes.shape[1:])])
    scale = weight_of_point(noise, slopes.shape[-1])
    return Rivals(
        loads=experiment.loads,
        states=states,
        square=scale * np.einsum("kgn,kgn->k", residuals, residuals),
        score=scale * np.einsum("ikgn,kgn->ki", every, residuals),
        normal=scale * np.einsum("ikgn,jkgn->kij", every, every),
        prior=np.diag(np.concatenate([unknowns.prior, np.ones(len(moved))])),
    )
