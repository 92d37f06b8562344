"""The field in both polarities, which separates the stiffness from a tilted moment and from a background field.

A reversed current reverses the deflection by the coil's field (its odd part). The part that does not depend on the
current, or depends on its square, is unchanged (the even part). The modulus follows from the odd part. The direction of
magnetisation and a background field follow from the even part, so that a fit frees them where both polarities were
measured.
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
    """Return whether the loads have fields in opposite directions."""
    strongest = loads.field_T[np.argmax((loads.field_T**2).sum(axis=1))]
    return bool((loads.field_T @ strongest).min() < -_OPPOSITE * float(strongest @ strongest))


def freed_by_polarities(experiments: Sequence[Experiment], free: Sequence[NuisancePrior]) -> tuple[NuisancePrior, ...]:
    """Return the sources to free: every experiment states them and has both polarities of the field.

    Parameters
    ----------
    experiments : sequence of Experiment
        The experiments of a fit.
    free : sequence of NuisancePrior
        The sources that the user frees.

    Returns
    -------
    tuple of NuisancePrior
        The further sources, each with its stated standard uncertainty as prior.
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
