"""The data of a bootstrap replicate: states drawn again, with replacement.

What one frame has in common (its light, its blur, where the clamp and the beam came to rest) moves all points of its
edges together: points are not independent, states are. So whole states are drawn (resampling cases: Davison and Hinkley
1997, Bootstrap Methods and their Application, section 6.2.4; blocks keep the dependence within them: Künsch 1989, Ann.
Statist. 17:1217).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eimi_fitting.inference.evidence.experiment import Experiment


def resampled(experiments: Sequence[Experiment], seed: int, replicate: int) -> list[Experiment]:
    """The experiments with as many states each, drawn with replacement and kept in their order.

    The same seed and replicate draw the same states, whatever else is drawn.
    """
    drawn = []
    for index, experiment in enumerate(experiments):
        rng = np.random.default_rng([seed, replicate, index])
        k_states = len(experiment.loads)
        states = np.sort(rng.integers(k_states, size=k_states))
        drawn.append(experiment.of_states(states))
    return drawn
