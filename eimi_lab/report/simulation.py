"""Identified laws simulated for a dataset, to be laid over what the camera saw."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.experiment import compare
from eimi_fitting.materials import LAWS
from eimi_fitting.observation import edge_curves, points_on
from eimi_lab.errors import InputError
from eimi_lab.identification.experiments import Evidence
from eimi_lab.identification.fits import FitRecord

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Simulated:
    """One fit on one dataset, K states in the order of the evidence.

    edges_mm: (K, 2, n, 2) left and right; residuals_mm: (K, 2, m) signed distances of the measured edge points or
    components of tracked points, NaN where nothing was observed; error_mm: (K,); fitted: whether the fit used this
    dataset or sees it for the first time.
    """

    fit: FitRecord
    edges_mm: Array
    residuals_mm: Array
    error_mm: Array
    fitted: bool


def simulate_fit(fit: FitRecord, evidence: Evidence) -> Simulated:
    """Simulate an identified law on a dataset. Raises InputError when it finds no equilibrium there."""
    law, parameters = LAWS[fit.model], np.array([fit.values()])
    experiment = evidence.experiment
    comparison = compare(law, parameters, [experiment])
    if comparison.unconverged[0]:
        raise InputError(f"{evidence.path}: the {fit.model} law of the fit finds no equilibrium for this specimen")
    shapes = experiment.model.solve(law, parameters, experiment.loads)
    misfit = comparison.misfits[0]
    return Simulated(
        fit,
        points_on(edge_curves(experiment.model, shapes)[0], 6),
        np.where(misfit.weights > 0, misfit.residuals[0], np.nan),
        comparison.error_mm[0],
        evidence.sha256 in {reference.sha256 for reference in fit.datasets},
    )
