"""Draw states of experiments at random with replacement, as the bootstrap method does to estimate uncertainties.

A state is one load on the specimen, with the points of the edges that one frame shows. The light, the blur and the rest
position of clamp and beam are common to one frame. An error of these quantities moves all points of the edges together.
The points of a state are therefore dependent, and the states are assumed independent. Whole states are drawn
(resampling cases: Davison and Hinkley 1997, Bootstrap Methods and their Application, section 6.2.4). A state is thus a
block of points, and the dependence within the block is kept (Künsch 1989, Ann. Statist. 17:1217).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eimi_fitting.inference.evidence.experiment import Experiment


def resampled(experiments: Sequence[Experiment], seed: int, replicate: int) -> list[Experiment]:
    """Return each experiment with its load states drawn at random with replacement (a bootstrap sample).

    Parameters
    ----------
    experiments : sequence of Experiment
        The measured experiments.
    seed : int
        Seed of the random numbers.
    replicate : int
        Number of the random sample. The same seed and number always draw the same states.

    Returns
    -------
    list of Experiment
        One random sample of each experiment.
    """
    replicates = []
    for index, experiment in enumerate(experiments):
        rng = np.random.default_rng([seed, replicate, index])
        k_states = len(experiment.loads)
        states = np.sort(rng.integers(k_states, size=k_states))
        replicates.append(experiment.of_states(states))
    return replicates
