"""The 95 % interval of the error of a fit on a dataset, from the uncertainties of fit and dataset."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.equilibrium import Configuration
from eimi_fitting.inference.evidence.measurements import Misfit
from eimi_fitting.inference.evidence.sources import SOURCES, StatedSource
from eimi_fitting.inference.evidence.unknowns import freed_number
from eimi_fitting.inference.evidence.unknowns import shared as sources_shared
from eimi_fitting.inference.interval.considered import Candidate, changes_by, coarse_model
from eimi_fitting.laws import LAWS
from eimi_lab.fits.assumptions import assumptions_of
from eimi_lab.fits.evidence import Evidence
from eimi_lab.fits.records import DatasetReference, FitRecord
from eimi_lab.fits.tensile_record import TensileRecord
from eimi_lab.fits.time_records import RingDownRecord

Array = NDArray[np.float64]

_DRAWS = 16  # draws of the fit, evenly spread over the modulus
_TIMES = 25  # draws of the independent sources for each draw of the parameters


def error_interval_mm(
    fit: FitRecord | TensileRecord | RingDownRecord, evidence: Evidence, residuals_mm: Array
) -> tuple[float, float | None] | None:
    """Return the 95 % interval of the mean error of a fit on a dataset (mm).

    Parameters
    ----------
    fit : FitRecord or TensileRecord or RingDownRecord
        Fit with random samples of its result.
    evidence : Evidence
        Dataset: beam model, loads and measured edges.
    residuals_mm : ndarray, shape (K, 2, m)
        Residuals of the fit: K states, two edges (or x and y of tracked points), m points. NaN without a point.

    Returns
    -------
    tuple of float, or None
        Lower and upper end. The upper end is None if the beam has no equilibrium for a sample; the result is None
        without samples.
    """
    candidates = np.concatenate([[fit.values()], fit.drawn(_DRAWS)])
    assumptions = assumptions_of(fit, evidence, len(candidates))
    experiment = assumptions.applied(evidence.experiment)
    coarse = replace(experiment, model=coarse_model(experiment.model.specimen))
    comparison = assumptions.compared(fit.model, candidates, coarse, keep=True)
    # The error of the coarse mesh is assumed to be the same for all samples.
    coarse_mm, converged = comparison.misfits[0].residuals, ~comparison.unconverged
    misfit = coarse.observed.of_residuals(np.nan_to_num(residuals_mm) + coarse_mm - coarse_mm[:1])
    errors_mm = predicted_errors_mm(fit, evidence, misfit, comparison.shapes[0].every)[:, converged[1:] & converged[0]]
    if not errors_mm.size:
        return None
    low, high = np.quantile(errors_mm, [0.025, 0.975]).tolist()
    mean = float(misfit.error_mm[0].mean())
    return min(low, mean), max(high, mean) if converged.all() else None


def predicted_errors_mm(
    fit: FitRecord | TensileRecord | RingDownRecord,
    evidence: Evidence,
    misfit: Misfit,
    near: Configuration | None = None,
) -> Array:
    """Return the mean errors of a fit on a dataset, for D random samples of the fit and T samples of the inputs.

    The inputs of the dataset are drawn at random with their uncertainties.

    Parameters
    ----------
    fit : FitRecord or TensileRecord or RingDownRecord
        Fit with random samples of its result.
    evidence : Evidence
        Dataset: beam model, loads and measured edges.
    misfit : Misfit
        Residuals of the fit, followed by those of the D samples.
    near : Configuration, optional
        Equilibrium in each state, as a starting point.

    Returns
    -------
    ndarray, shape (T, D)
        Mean errors over the states in mm.
    """
    residuals = misfit.residuals[1:]
    count = np.maximum(misfit.weights.sum(axis=(1, 2)), 1.0)
    numbers = _uncertain_numbers(fit, evidence)
    sizes = [(stated.source, part, stated.standard_uncertainty) for stated, part in numbers]
    experiment = assumptions_of(fit, evidence, 1).applied(evidence.experiment)
    computed = zip(numbers, changes_by(_candidate(fit, evidence), experiment, sizes, near), strict=True)
    changes = [(number, change) for number, change in computed if change is not None]
    if not changes:
        return np.asarray(misfit.error_mm[None, 1:].mean(axis=2))
    common = [_shared_deviations(fit, *number, len(residuals)) for number, _ in changes]
    changes_mm = np.stack([change for _, change in changes])
    rng = np.random.default_rng(fit.draws.seed if fit.draws else 0)
    errors = []
    for _ in range(_TIMES):
        deviations = [rng.normal(size=len(residuals)) if shared is None else shared for shared in common]
        moved = residuals + np.einsum("sd,skgm->dkgm", np.array(deviations), changes_mm)
        errors.append(np.sqrt((moved**2).sum(axis=(2, 3)) / count).mean(axis=1))
    return np.array(errors)


def _uncertain_numbers(
    fit: FitRecord | TensileRecord | RingDownRecord, evidence: Evidence
) -> list[tuple[StatedSource, int]]:
    """Return all components of the uncertain inputs of a dataset, as pairs of input and index (0 for x, 1 for y)."""
    freed = {source for source, _, _ in _candidate(fit, evidence).freed}
    identified = freed.union(*(SOURCES[source].covers for source in freed))
    return [
        (stated, part)
        for stated in evidence.experiment.stated
        if stated.standard_uncertainty and stated.source not in identified
        for part in range(len(SOURCES[stated.source].parts))
    ]


def _candidate(fit: FitRecord | TensileRecord | RingDownRecord, evidence: Evidence) -> Candidate:
    """Return the law, its parameters and the fitted uncertain inputs for a simulation."""
    places = [i for i, reference in enumerate(_datasets(fit)) if reference.sha256 == evidence.sha256]
    freed = fit.freed if isinstance(fit, FitRecord) and places else ()
    return Candidate(
        LAWS[fit.model],
        np.array([fit.values()]),
        assumptions_of(fit, evidence, 1).bulk_modulus_Pa,
        tuple((*freed_number(f.name), f.deviation.value) for f in freed if places[0] in f.datasets),
    )


def _datasets(fit: FitRecord | TensileRecord | RingDownRecord) -> tuple[DatasetReference, ...]:
    return fit.datasets if isinstance(fit, FitRecord) else ()


def _shared_deviations(
    fit: FitRecord | TensileRecord | RingDownRecord, stated: StatedSource, part: int, draws: int
) -> Array | None:
    # The random errors of the input `stated` in the samples of a fit, in standard uncertainties. None if the fit does
    # not share this input, such as the coil constant, with the predicted dataset. `part` is 0 for x, 1 for y.
    by_dataset = [reference.stated for reference in _datasets(fit)]
    for group in sources_shared(stated.source, by_dataset):
        of = {source.of for i in group.datasets for source in by_dataset[i] if source.source == stated.source}
        if stated.of in of and group.standard_uncertainty:
            drawn = fit.drawn_deviation(group.part_name(part, len(by_dataset)), draws)
            return None if drawn is None else drawn / group.standard_uncertainty
    return None
