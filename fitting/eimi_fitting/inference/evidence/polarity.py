"""Use a field in both directions to separate the modulus from a tilted magnetisation and from a background field.

Two load cases with opposite currents of equal strength have two deflections. Half of the difference of the deflections
is caused by the field of the coil, and the modulus follows from it. Half of the sum does not change sign with the
current. The direction of magnetisation and the background field follow from it. If both directions were measured, a fit
therefore also determines the direction of magnetisation and the background field.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eimi_fitting.beam.loads import Loads
from eimi_fitting.inference.evidence.experiment import Experiment
from eimi_fitting.inference.evidence.sources import SOURCES
from eimi_fitting.inference.evidence.unknowns import NuisancePrior

_OPPOSITE = 0.2  # share of the strongest field that a field of the other polarity has to reach


def has_both_polarities(loads: Loads) -> bool:
    """Return whether the field of a load case opposes the strongest field, with more than a fifth of its strength."""
    strongest = loads.field_T[np.argmax((loads.field_T**2).sum(axis=1))]
    return bool((loads.field_T @ strongest).min() < -_OPPOSITE * float(strongest @ strongest))


def freed_by_polarities(experiments: Sequence[Experiment], free: Sequence[NuisancePrior]) -> tuple[NuisancePrior, ...]:
    """Return the uncertain inputs that can be fitted because the field was measured in both directions.

    An example is the background field: its effect does not change sign with the field of the coil.

    Parameters
    ----------
    experiments : sequence of Experiment
        The experiments of a fit.
    free : sequence of NuisancePrior
        The inputs that the user fits already. They are not returned.

    Returns
    -------
    tuple of NuisancePrior
        The inputs whose effect is the same in a reversed field, if every experiment specifies an uncertainty above 0
        for them. This uncertainty is the prior standard deviation. Empty if an experiment has only one direction of the
        field.
    """
    if not all(has_both_polarities(experiment.loads) for experiment in experiments):
        return ()
    freed = {prior.kind for prior in free}
    uncertain = [{s.source for s in e.stated if s.standard_uncertainty} for e in experiments]
    return tuple(
        NuisancePrior(source)
        for source, entry in SOURCES.items()
        if entry.is_even and source not in freed and all(source in of_experiment for of_experiment in uncertain)
    )
