"""The error that a fit is to be expected to have on a dataset, with all that is uncertain about both.

Parameters are those of the fit's draws. What the dataset states as uncertain is drawn beside them: a source that the
fit's own data had in common with it (one coil, one calibration, one caliper) as it is in the same draw, for a modulus
that is too high by a coil that is too strong bends this beam just as far; any other by itself.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.equilibrium import Configuration
from eimi_fitting.inference.evidence.measurements import Misfit
from eimi_fitting.inference.evidence.sources import SOURCES, StatedSource
from eimi_fitting.inference.evidence.unknowns import freed_number, shared
from eimi_fitting.inference.interval.considered import Candidate, changes_by, coarse_model
from eimi_fitting.laws import LAWS
from eimi_lab.fits.assumptions import assumptions_of
from eimi_lab.fits.evidence import Evidence
from eimi_lab.fits.records import DatasetReference, FitRecord, TensileRecord

Array = NDArray[np.float64]

_DRAWS = 16  # of the fit's, evenly over the modulus
_TIMES = 25  # that each draw of the parameters meets sources of its own


def error_interval_mm(
    fit: FitRecord | TensileRecord, evidence: Evidence, residuals_mm: Array
) -> tuple[float, float | None] | None:
    """95 % of the mean errors of some draws, and that of the fit itself; None without draws.

    residuals_mm: (K, G, m) of the fit itself, NaN where nothing was observed. The draws bend on the coarse mesh, from
    where the fit does there: what better models change in one they change in the others. No upper end where one of the
    draws has no equilibrium.
    """
    candidates = np.concatenate([[fit.values()], fit.drawn(_DRAWS)])
    coarse = replace(evidence.experiment, model=coarse_model(evidence.experiment.model.specimen))
    every = assumptions_of(fit, evidence, len(candidates)).compared(fit.model, candidates, coarse, keep=True)
    bent, sound = every.misfits[0].residuals, ~every.unconverged
    drawn = coarse.observed.of_residuals(np.nan_to_num(residuals_mm) + bent - bent[:1])
    errors_mm = predicted_errors_mm(fit, evidence, drawn, every.shapes[0].every)[:, sound[1:] & sound[0]]
    if not errors_mm.size:
        return None
    low, high = np.quantile(errors_mm, [0.025, 0.975]).tolist()
    mean = float(drawn.error_mm[0].mean())
    return min(low, mean), max(high, mean) if sound.all() else None


def predicted_errors_mm(
    fit: FitRecord | TensileRecord, evidence: Evidence, misfit: Misfit, near: Configuration | None = None
) -> Array:
    """(T, D): mean errors of the fit's draws on a dataset, T times with other deviations of its sources.

    misfit: of the fit itself and D of its draws (1 + D, ...); near: where the fit's beam stands on the coarse mesh, or
    nearly so, a row a state.
    """
    residuals = misfit.residuals[1:]
    count = np.maximum(misfit.weights.sum(axis=(1, 2)), 1.0)
    numbers = _numbers(fit, evidence)
    sizes = [(stated.source, part, stated.standard_uncertainty) for stated, part in numbers]
    found = zip(numbers, changes_by(_candidate(fit, evidence), evidence.experiment, sizes, near), strict=True)
    changes = [(number, change) for number, change in found if change is not None]
    if not changes:
        return np.asarray(misfit.error_mm[None, 1:].mean(axis=2))
    known = [_as_drawn(fit, *number, len(residuals)) for number, _ in changes]
    every = np.stack([change for _, change in changes])
    rng = np.random.default_rng(fit.draws.seed if fit.draws else 0)
    errors = []
    for _ in range(_TIMES):
        deviations = [rng.normal(size=len(residuals)) if own is None else own for own in known]
        moved = residuals + np.einsum("sd,skgm->dkgm", np.array(deviations), every)
        errors.append(np.sqrt((moved**2).sum(axis=(2, 3)) / count).mean(axis=1))
    return np.array(errors)


def _numbers(fit: FitRecord | TensileRecord, evidence: Evidence) -> list[tuple[StatedSource, int]]:
    """What the dataset states as uncertain, and the fit did not find for it."""
    freed = {source for source, _, _ in _candidate(fit, evidence).freed}
    found = freed.union(*(SOURCES[source].covers for source in freed))
    return [
        (stated, part)
        for stated in evidence.experiment.stated
        if stated.standard_uncertainty and stated.source not in found
        for part in range(len(SOURCES[stated.source].parts))
    ]


def _candidate(fit: FitRecord | TensileRecord, evidence: Evidence) -> Candidate:
    own = [i for i, reference in enumerate(_datasets(fit)) if reference.sha256 == evidence.sha256]
    every = fit.freed if isinstance(fit, FitRecord) and own else ()
    return Candidate(
        LAWS[fit.model],
        np.array([fit.values()]),
        assumptions_of(fit, evidence, 1).bulk_modulus_Pa,
        tuple((*freed_number(f.name), f.deviation.value) for f in every if own[0] in f.datasets),
    )


def _datasets(fit: FitRecord | TensileRecord) -> tuple[DatasetReference, ...]:
    return fit.datasets if isinstance(fit, FitRecord) else ()


def _as_drawn(fit: FitRecord | TensileRecord, stated: StatedSource, part: int, draws: int) -> Array | None:
    """(D,) standard uncertainties, where the fit's data had this error too; None where it is the dataset's own."""
    every = [reference.stated for reference in _datasets(fit)]
    for group in shared(stated.source, every):
        of = {own.of for i in group.datasets for own in every[i] if own.source == stated.source}
        if stated.of in of and group.standard_uncertainty:
            drawn = fit.drawn_deviation(group.part_name(part, len(every)), draws)
            return None if drawn is None else drawn / group.standard_uncertainty
    return None
