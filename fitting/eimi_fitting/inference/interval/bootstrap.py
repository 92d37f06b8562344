"""Draw load cases of experiments at random with replacement, as the bootstrap method does to estimate uncertainties.

The edges of one load case are measured in one frame. An error of light, blur or rest position moves all points of a
frame together. The points of a load case are therefore dependent, and the load cases are assumed independent. Whole
load cases are drawn (resampling cases: Davison and Hinkley 1997, Bootstrap Methods and their Application, section
6.2.4). The dependence of the points within a load case is thus kept (Künsch 1989, Ann. Statist. 17:1217).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eimi_fitting.inference.evidence.experiment import Experiment


def resampled(experiments: Sequence[Experiment], seed: int, replicate: int) -> list[Experiment]:
    """Return each experiment with its load cases drawn at random with replacement (a bootstrap sample).

    Parameters
    ----------
    experiments : sequence of Experiment
        The measured experiments.
    seed : int
        Seed of the random numbers.
    replicate : int
        Index of the bootstrap sample. The same seed and index always give the same load cases.

    Returns
    -------
    list of Experiment
        The experiments with as many load cases as before. A load case may occur several times.
    """
    replicates = []
    for index, experiment in enumerate(experiments):
        rng = np.random.default_rng([seed, replicate, index])
        k_states = len(experiment.loads)
        states = np.sort(rng.integers(k_states, size=k_states))
        replicates.append(experiment.of_states(states))
    return replicates
