"""A fit simulated on a dataset, seen or not, and how far off it is.

On a dataset that it has seen, a fit keeps the nuisances that it freed (magnetic moment, roll and so on); on any other
they are as stated.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.beside import FORETOLD_MM, Reach
from eimi_fitting.beam.outline import outline, points_on
from eimi_fitting.inference.evidence.corrections import Correction, correction, polished, refinements
from eimi_fitting.inference.evidence.experiment import Comparison, Experiment
from eimi_fitting.inference.evidence.measurements import EdgeObservation, Misfit
from eimi_lab.fits.assumptions import assumptions_of
from eimi_lab.fits.evidence import Evidence
from eimi_lab.fits.predicted_error import error_interval_mm
from eimi_lab.fits.records import FitRecord, StateError, TensileRecord
from eimi_lab.fits.validation import FitReference, Validation
from eimi_lab.process.errors import InputError

Array = NDArray[np.float64]

_SAME_STRETCH = 1e-3  # two simulations of one beam may differ by this much
# Of a fit's own error, or a micrometre: what depth adds to its edges is known this well. Of a fit that is hundreds of
# micrometres off one or two states then tell, and no digit that counts is theirs.
_OF_ERROR = 0.01

FitOfFile = tuple[Path, int, FitRecord | TensileRecord]
"""A fit with its file and its place there."""


@dataclass(frozen=True)
class Prediction:
    """A fit simulated on a dataset of K states, and what that is worth.

    correction: by the better model, None without an equilibrium; edges_mm: (K, 2, n, 2) simulated left and right edges
    as the camera has them, by that model where it has one; residuals_mm: (K, 2, m) signed distances of the measured
    edge points or components of tracked points, NaN where nothing was observed; error_mm, deviation_mm: (K,).
    They mean nothing where the validation's status is not "ok".
    """

    validation: Validation
    correction: Correction | None
    edges_mm: Array
    residuals_mm: Array
    error_mm: Array
    deviation_mm: Array

    def without_correction(self) -> Prediction:
        """The same without the solid's shapes, which are large, and nothing that is shown."""
        return replace(self, correction=None)

    def with_interval(self, interval_mm: tuple[float, float | None] | None) -> Prediction:
        """The same with the interval of the mean error, which takes long to find and nothing else needs."""
        return replace(self, validation=self.validation.model_copy(update={"mean_error_interval_mm": interval_mm}))


def validate(evidence: Evidence, fit: FitRecord | TensileRecord, path: Path, index: int) -> Validation:
    """The error of the fit ``index`` of the file ``path`` on a dataset. Raises InputError as `simulate` does."""
    return predict(evidence, fit, path, index).validation


def predict(evidence: Evidence, fit: FitRecord | TensileRecord, path: Path, index: int) -> Prediction:
    """Simulate the fit ``index`` of the file ``path`` on a dataset, with the interval of its error.

    Raises InputError as `simulate` does.
    """
    return _with_interval(evidence, fit, simulate(evidence, fit, path, index))


def predict_each(evidence: Evidence, fits: Sequence[FitOfFile]) -> Iterator[Prediction]:
    """`predict` of several fits. Raises InputError as `simulate` does."""
    for (path, index, fit), found in zip(fits, simulate_each(evidence, fits), strict=True):
        yield _with_interval(evidence, fit, found or simulate(evidence, fit, path, index, "followed"))


def _with_interval(evidence: Evidence, fit: FitRecord | TensileRecord, found: Prediction) -> Prediction:
    is_solved = found.validation.status == "ok"
    return found.with_interval(error_interval_mm(fit, evidence, found.residuals_mm)) if is_solved else found


def simulate_each(evidence: Evidence, fits: Sequence[FitOfFile]) -> Iterator[Prediction | None]:
    """`simulate` of several fits, at the cost of fewer: None for those that have to be simulated by themselves.

    What depth adds is much the same for fits that bend the beam alike: each begins with what was found before. Where
    it is large a solid has to be followed through all states, which takes long and tells nothing of the other fits.
    Raises InputError as `simulate` does.
    """
    near: list[Correction] = []
    every = _planar_comparisons(evidence, [fit for _, _, fit in fits])
    for (path, index, fit), plain in zip(fits, every, strict=True):
        found = _simulated(evidence, fit, path, index, near, plain, "at once")
        near += [found.correction.without_shapes()] if found and found.correction else []
        yield found


def simulate(
    evidence: Evidence, fit: FitRecord | TensileRecord, path: Path, index: int, reach: Reach = "any"
) -> Prediction:
    """Simulate the fit ``index`` of the file ``path`` on a dataset and measure its error, without an interval.

    reach: "followed" for one that `simulate_each` did not reach.
    Raises InputError when the fit was made from this very dataset under another section assumption.
    """
    (plain,) = _planar_comparisons(evidence, [fit])
    found = _simulated(evidence, fit, path, index, (), plain, reach)
    assert found
    return found


def _planar_comparisons(evidence: Evidence, fits: Sequence[FitRecord | TensileRecord]) -> list[Comparison]:
    """How far each fit is from a dataset on the planar model on which its correction begins.

    Those of one law that assume nothing else of the dataset are one batch.
    """
    experiment = polished(evidence.experiment)
    own = [assumptions_of(fit, evidence, 1) for fit in fits]
    batches: dict[object, list[int]] = {}
    for i, fit in enumerate(fits):
        is_alone = own[i].bulk_modulus_Pa is not None or own[i].setup is not None
        batches.setdefault(i if is_alone else fit.model, []).append(i)
    found: dict[int, Comparison] = {}
    for batch in batches.values():
        values = np.array([fits[i].values() for i in batch])
        every = own[batch[0]].compared(fits[batch[0]].model, values, experiment)
        found |= {i: every.take(np.array([row])) for row, i in enumerate(batch)}
    return [found[i] for i in range(len(fits))]


def _simulated(
    evidence: Evidence,
    fit: FitRecord | TensileRecord,
    path: Path,
    index: int,
    near: Sequence[Correction],
    plain: Comparison,
    reach: Reach,
) -> Prediction | None:
    """See `simulate`. near: the corrections of other fits on the same dataset; plain: of `_planar_comparisons`;
    reach: how a solid is sought; None where it has to be followed and may not.
    """
    section = evidence.experiment.model.specimen.section
    used = {reference.sha256: reference for reference in fit.datasets} if isinstance(fit, FitRecord) else {}
    seen = used.get(evidence.sha256)
    if seen is not None and seen.section != section:
        raise InputError(
            f"{path}: fits.{index} took {evidence.path} as {seen.section}, not {section}; give --section {seen.section}"
        )
    experiment, own = polished(evidence.experiment), assumptions_of(fit, evidence, 1)

    def against(experiments: Sequence[Experiment]) -> Comparison:
        return own.compared(fit.model, np.array([fit.values()]), experiments[0])

    (due,) = refinements([experiment])
    foretold_mm = max(FORETOLD_MM, _OF_ERROR * float(plain.error_mm[0].mean()))
    # Where the planar model has no equilibrium there is none to report, whatever a better one says.
    bent = not plain.unconverged[0]
    found = correction(due, [experiment], plain, against, near, foretold_mm, reach) if bent else None
    if section == "solid" and bent and found is None and reach == "at once":
        return None
    observed, residuals = experiment.observed, plain.misfits[0].residuals
    misfit = observed.of_residuals(residuals + found.changes[0] if found else residuals)
    model, shapes = (found.models[0], found.better.shapes[0]) if found else (experiment.model, plain.shapes[0])
    view = observed.view if isinstance(observed, EdgeObservation) else None
    solved = bent and (section != "solid" or found is not None)
    return Prediction(
        validation=_validation(
            evidence, fit, FitReference.of(fit, path, index), seen is not None, plain, misfit, solved
        ),
        correction=found,
        edges_mm=own.as_measured(points_on(outline(model, shapes, view)[0], 6)),
        residuals_mm=np.where(misfit.weights > 0, misfit.residuals[0], np.nan),
        error_mm=misfit.error_mm[0],
        deviation_mm=misfit.deviation_mm[0],
    )


def _validation(
    evidence: Evidence,
    fit: FitRecord | TensileRecord,
    reference: FitReference,
    seen: bool,
    plain: Comparison,
    misfit: Misfit,
    solved: bool,
) -> Validation:
    """plain: of the fit on the planar mesh; misfit: with what a better model changes in it."""
    common: dict[str, Any] = {
        "dataset": str(evidence.path),
        "sha256": evidence.sha256,
        "section": evidence.experiment.model.specimen.section,
        "model": fit.model,
        "fit": reference,
        "initial_shear_modulus": fit.initial_shear_modulus,
        "seen": seen,
        "states": evidence.used,
    }
    if not solved:
        nothing: dict[str, Any] = dict.fromkeys(
            ("mean_error_mm", "mean_error_interval_mm", "mean_deviation_mm", "max_stretch", "stable")
        )
        return Validation(**common, **nothing, status="no equilibrium", within_fitted_stretch=None, by_state=())
    stretch = float(plain.max_stretch[0])
    return Validation(
        **common,
        status="ok",
        mean_error_mm=float(misfit.error_mm[0].mean()),
        mean_error_interval_mm=None,
        mean_deviation_mm=float(misfit.deviation_mm[0].mean()),
        max_stretch=stretch,
        stable=not plain.unstable[0],
        within_fitted_stretch=stretch <= fit.max_stretch + _SAME_STRETCH,
        by_state=StateError.of(evidence, misfit.error_mm[0], misfit.deviation_mm[0]),
    )
