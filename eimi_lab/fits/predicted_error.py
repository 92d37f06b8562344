"""Compute the interval of the error of a fit on a dataset, from the uncertainties of fit and dataset.

The fit contains random samples (draws) from the distribution of its result. The dataset is simulated with the
parameters of each draw and with a random deviation of each of its own uncertain inputs. The interval follows from the
errors of all simulations.

Fit and dataset may have an error in common, for example because the same coil, calibration or calliper was used. A coil
that is weaker than stated makes the identified modulus too high. If the same coil acts on the beam of the dataset, both
errors cancel. The deviation of such a shared input is therefore taken from the same draw as the parameters. The
deviations of all other inputs are drawn independently.
"""

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
    """Return the 95 % interval of the mean error of a fit on a dataset.

    The fit contains draws: random samples of the parameters and the uncertain inputs. To save time, each draw is
    simulated only on a coarse mesh. This gives the difference between the residuals of the draw and those of the fit,
    both on the coarse mesh. The difference is added to `residuals_mm`, the residuals of the fit from a more accurate
    simulation. The error of the coarse mesh is thus assumed to be the same for all draws.

    Parameters
    ----------
    fit : FitRecord or TensileRecord
        The fit, with random samples (draws) of its result.
    evidence : Evidence
        The dataset, with its beam model, loads and measured edges.
    residuals_mm : ndarray, shape (K, G, m)
        Residuals of the fit in K states. The second axis (G = 2) holds the left and right edge or, for tracked points,
        the x and y components. The last axis holds m points. NaN where no point was measured.

    Returns
    -------
    tuple of float, or None
        The lower and the upper end of the interval in mm. The interval contains the mean error of the fit. The upper
        end is None if the beam has no equilibrium for a draw. The result is None if the fit has no draws.
    """
    candidates = np.concatenate([[fit.values()], fit.drawn(_DRAWS)])
    assumptions = assumptions_of(fit, evidence, len(candidates))
    experiment = assumptions.applied(evidence.experiment)
    coarse = replace(experiment, model=coarse_model(experiment.model.specimen))
    comparison = assumptions.compared(fit.model, candidates, coarse, keep=True)
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
    """Return the mean error of a fit on a dataset for each of D draws of the fit, repeated T times.

    Draws are random samples of the parameters and the uncertain inputs. Some inputs of the dataset are independent of
    the data of the fit, for example another coil. Their deviations are drawn again in each repetition.

    Parameters
    ----------
    fit : FitRecord or TensileRecord
        The fit, with random samples (draws) of its result.
    evidence : Evidence
        The dataset, with its beam model, loads and measured edges.
    misfit : Misfit
        Residuals of the fit and of its D draws; the first axis has 1 + D entries, the fit first.
    near : Configuration, optional
        Equilibrium of the fit on the coarse mesh in each state, as a starting point.

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
    """Return the uncertain inputs of a dataset: a pair for each component of an input, with the input and an index.

    For example, the place of the clamp has two components, x and y, with the indices 0 and 1. Inputs that were fitted
    together with the law are left out.
    """
    freed = {source for source, _, _ in _candidate(fit, evidence).freed}
    identified = freed.union(*(SOURCES[source].covers for source in freed))
    return [
        (stated, part)
        for stated in evidence.experiment.stated
        if stated.standard_uncertainty and stated.source not in identified
        for part in range(len(SOURCES[stated.source].parts))
    ]


def _candidate(fit: FitRecord | TensileRecord | RingDownRecord, evidence: Evidence) -> Candidate:
    """Return what has to be simulated for a fit: the law with its parameters, and the values of uncertain inputs.

    These inputs are those that were fitted to this dataset together with the law; there are none for another dataset.
    """
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
    """Return the errors of an input in the D draws (random samples) of a fit, in standard uncertainties, (D,).

    A prediction uses them again if the predicted dataset has the same error as the data of the fit, for example because
    the same coil was used. The result is None for a dataset without this error. `stated` is the uncertain input of the
    predicted dataset, and `part` the index of one of its components, such as x or y.
    """
    by_dataset = [reference.stated for reference in _datasets(fit)]
    for group in sources_shared(stated.source, by_dataset):
        of = {source.of for i in group.datasets for source in by_dataset[i] if source.source == stated.source}
        if stated.of in of and group.standard_uncertainty:
            drawn = fit.drawn_deviation(group.part_name(part, len(by_dataset)), draws)
            return None if drawn is None else drawn / group.standard_uncertainty
    return None
