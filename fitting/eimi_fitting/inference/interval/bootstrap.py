"""Draw load cases of experiments at random with replacement (bootstrap)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eimi_fitting.inference.evidence.experiment import Experiment


def resampled(experiments: Sequence[Experiment], seed: int, replicate: int) -> list[Experiment]:
    """Return each experiment with its load cases drawn at random with replacement (a bootstrap sample)."""
    # `replicate` is the number of the sample.
    # The edges of one load case are measured in one frame. An error of light, blur or rest position moves all points of
    # a frame together. Whole load cases are therefore drawn (resampling cases: Davison and Hinkley 1997, Bootstrap
    # Methods and their Application, section 6.2.4), which keeps the dependence of the points (Künsch 1989, Ann.
    # Statist. 17:1217).
    replicates = []
    for index, experiment in enumerate(experiments):
        rng = np.random.default_rng([seed, replicate, index])
        k_states = len(experiment.loads)
        states = np.sort(rng.integers(k_states, size=k_states))
        replicates.append(experiment.of_states(states))
    return replicates
