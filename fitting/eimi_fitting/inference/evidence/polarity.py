"""Find the uncertain inputs that a fit can determine if load cases have opposite magnetic fields."""

# The modulus follows from the difference of the deflections for two opposite fields. The background field and the
# direction of magnetisation follow from their sum.

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eimi_fitting.beam.loads import Loads
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.sources import SOURCES
from eimi_fitting.inference.evidence.unknowns import NuisancePrior

_OPPOSITE = 0.2  # share of the strongest field that a field of the other polarity has to reach


def has_both_polarities(loads: Loads) -> bool:
    """Return whether the load cases contain two opposite magnetic fields."""
    strongest = loads.field_T[np.argmax((loads.field_T**2).sum(axis=1))]
    return bool((loads.field_T @ strongest).min() < -_OPPOSITE * float(strongest @ strongest))


def freed_by_polarities(experiments: Sequence[Experiment], free: Sequence[NuisancePrior]) -> tuple[NuisancePrior, ...]:
    """Return the uncertain inputs that a fit can determine because load cases have opposite magnetic fields."""
    # The result omits the inputs `free`, which are fitted already.
    if not all(has_both_polarities(experiment.loads) for experiment in experiments):
        return ()
    # The effect of an even input does not change sign with the field. Every experiment specifies its uncertainty, which
    # is the prior standard deviation.
    freed = {prior.kind for prior in free}
    uncertain = [{s.source for s in e.stated if s.standard_uncertainty} for e in experiments]
    return tuple(
        NuisancePrior(source)
        for source, entry in SOURCES.items()
        if entry.is_even and source not in freed and all(source in of_experiment for of_experiment in uncertain)
    )
