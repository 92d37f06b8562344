"""Draw the data of a bootstrap replicate: whole states, with replacement.

The light, the blur and the rest position of clamp and beam are common to one frame. They move all points of its edges
together, so that the points of a state are dependent and the states are independent. Whole states are therefore drawn
(resampling cases: Davison and Hinkley 1997, Bootstrap Methods and their Application, section 6.2.4). Drawing in blocks
keeps the dependence within a block (Künsch 1989, Ann. Statist. 17:1217).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eimi_fitting.inference.evidence.experiment import Experiment


def resampled(experiments: Sequence[Experiment], seed: int, replicate: int) -> list[Experiment]:
    """Return each experiment with as many states as it has, drawn with replacement and kept in their order.

    Parameters
    ----------
    experiments : sequence of Experiment
        The measured experiments.
    seed : int
        Seed of the random numbers.
    replicate : int
        Number of the replicate. One seed and one replicate always draw the same states, whatever else is drawn.

    Returns
    -------
    list of Experiment
        One for each experiment.
    """
    replicates = []
    for index, experiment in enumerate(experiments):
        rng = np.random.default_rng([seed, replicate, index])
        k_states = len(experiment.loads)
        states = np.sort(rng.integers(k_states, size=k_states))
        replicates.append(experiment.of_states(states))
    return replicates
