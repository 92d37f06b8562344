"""Simulate the edges of a dataset with a fitted law, and compute the error of these edges."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.beside import ACCURACY_MM, Method, SolidOptions
from eimi_fitting.beam.outline import points_on
from eimi_fitting.inference.evidence.corrections import Correction, by_better_model, polished
from eimi_fitting.inference.evidence.experiment import Comparison, Experiment
from eimi_fitting.inference.evidence.measurements import Misfit
from eimi_lab.fits.assumptions import assumptions_of
from eimi_lab.fits.evidence import Evidence
from eimi_lab.fits.records import FitRecord, StateError
from eimi_lab.fits.tensile_record import TensileRecord
from eimi_lab.fits.time_records import RingDownRecord
from eimi_lab.fits.validation import FitReference, Validation
from eimi_lab.process.errors import InputError

Array = NDArray[np.float64]

_SAME_STRETCH = 1e-3  # difference of stretch that two simulations of one beam may have
# Accuracy of the correction for the depth, as a fraction of the error of the fit. For a fit with an error of hundreds
# of micrometres, one or two solved states are then enough.
_OF_ERROR = 0.01


@dataclass(frozen=True)
class FittedLaw:
    """A fit, with the path of its result file and its index in this file."""

    path: Path
    index: int
    fit: FitRecord | TensileRecord | RingDownRecord = field(compare=False)

    @property
    def label(self) -> str:
        """Return the name of the fit for progress lines, such as `fits.json, fits.0`."""
        return f"{self.path}, fits.{self.index}"


Law = TypeVar("Law", bound=FittedLaw)


@dataclass(frozen=True)
class Prediction(Generic[Law]):
    """The simulation of a fit on a dataset with K states. The arrays are empty if the beam has no equilibrium.

    Attributes
    ----------
    fitted_law : FittedLaw
        Fit, with its file.
    evidence : Evidence
        Dataset, with its beam model and loads.
    validation : Validation
        Errors of the fit on the dataset.
    edges_mm : ndarray, shape (K, 2, n, 2)
        Simulated edges in the picture; axes state, left and right edge, point, x and y.
    residuals_mm : ndarray, shape (K, 2, m)
        Distances of measured from simulated points; axes state, edge (or x and y of tracked points), point.
    error_mm, deviation_mm : ndarray, shape (K,)
        Root mean square and standard deviation of the distances in each state.
    """

    fitted_law: Law
    evidence: Evidence
    validation: Validation
    edges_mm: Array
    residuals_mm: Array
    error_mm: Array
    deviation_mm: Array

    @property
    def has_equilibrium(self) -> bool:
        """Return whether the simulated beam has an equilibrium in all states of the dataset."""
        return self.validation.status == "ok"

    def in_words(self) -> str:
        """Return the name of the dataset, and the file and index of the fit."""
        return f"{self.evidence.path.name}, {self.fitted_law.label}"


def simulate_each(evidence: Evidence, laws: Sequence[Law]) -> Iterator[Prediction[Law] | None]:
    """Simulate several fits on one dataset.

    Parameters
    ----------
    evidence : Evidence
        Dataset, with its beam model, loads and measured edges.
    laws : sequence of FittedLaw
        Fits.

    Yields
    ------
    Prediction or None
        Simulation of each fit; None if interpolation between a few solved states fails (then use `simulate_alone`).

    Raises
    ------
    InputError
        If a law was fitted to this dataset with another model of the cross-section.
    """
    # Similar fits have similar corrections, which are therefore starting points for the next fits.
    near: list[Correction] = []
    for fitted_law, plain in zip(laws, _planar_comparisons(evidence, [law.fit for law in laws]), strict=True):
        prediction, depth = _simulated(evidence, fitted_law, near, plain, "interpolate")
        near += [depth.without_shapes()] if depth else []
        yield prediction


def simulate_alone(evidence: Evidence, fitted_law: Law) -> Prediction[Law]:
    """Simulate the states of a dataset with one fitted law and the most accurate beam model.

    Raises InputError if the law was fitted to this dataset with another model of the cross-section.
    """
    (plain,) = _planar_comparisons(evidence, [fitted_law.fit])
    prediction, _ = _simulated(evidence, fitted_law, (), plain, "follow")
    assert prediction
    return prediction


def _planar_comparisons(
    evidence: Evidence, fits: Sequence[FitRecord | TensileRecord | RingDownRecord]
) -> list[Comparison]:
    """Compare a dataset with the simulation of each fit by a planar beam model."""
    assumptions = [assumptions_of(fit, evidence, 1) for fit in fits]
    batches: dict[object, list[int]] = {}
    for i, fit in enumerate(fits):
        is_alone = assumptions[i].bulk_modulus_Pa is not None or assumptions[i].setup is not None
        batches.setdefault(i if is_alone else fit.model, []).append(i)
    comparisons: dict[int, Comparison] = {}
    for batch in batches.values():
        values = np.array([fits[i].values() for i in batch])
        assumed = assumptions[batch[0]]
        of_batch = assumed.compared(fits[batch[0]].model, values, polished(assumed.applied(evidence.experiment)))
        comparisons |= {i: of_batch.take(np.array([row])) for row, i in enumerate(batch)}
    return [comparisons[i] for i in range(len(fits))]


def _simulated(
    evidence: Evidence, fitted_law: Law, near: Sequence[Correction], plain: Comparison, method: Method
) -> tuple[Prediction[Law] | None, Correction | None]:
    # Return the simulation of a fit, and the difference of its edges from those of a planar beam model. `near` holds
    # such differences for other fits, from which the solver of the accurate model starts. `plain` is the simulation
    # with the planar model.
    fit, path, index = fitted_law.fit, fitted_law.path, fitted_law.index
    section = evidence.experiment.model.specimen.section
    used = {reference.sha256: reference for reference in fit.datasets} if isinstance(fit, FitRecord) else {}
    reference = used.get(evidence.sha256)
    if reference is not None and reference.section != section:
        raise InputError(
            f"{path}: fits.{index} assumed {reference.section} for {evidence.path}, and not {section}; "
            f"give --section {reference.section}"
        )
    assumptions = assumptions_of(fit, evidence, 1)
    experiment = polished(assumptions.applied(evidence.experiment))

    def against(experiments: Sequence[Experiment]) -> Comparison:
        return assumptions.compared(fit.model, np.array([fit.values()]), experiments[0])

    options = SolidOptions(method, max(ACCURACY_MM, _OF_ERROR * float(plain.error_mm[0].mean())))
    better = by_better_model(experiment, plain, against, near, options)
    if better is None and method == "interpolate" and not plain.unconverged[0]:
        return None, None
    misfit, curves, correction = better or (None, None, None)
    validation = _validation(evidence, fitted_law, reference is not None, plain, misfit)
    if misfit is None or curves is None:
        nothing = np.zeros(0)
        return Prediction(fitted_law, evidence, validation, nothing, nothing, nothing, nothing), None
    prediction = Prediction(
        fitted_law,
        evidence,
        validation,
        edges_mm=assumptions.as_measured(points_on(curves, 6)),
        residuals_mm=np.where(misfit.weights > 0, misfit.residuals[0], np.nan),
        error_mm=misfit.error_mm[0],
        deviation_mm=misfit.deviation_mm[0],
    )
    return prediction, correction


def _validation(
    evidence: Evidence, fitted_law: FittedLaw, seen: bool, plain: Comparison, misfit: Misfit | None
) -> Validation:
    """Return the errors of a fit on a dataset; `seen` tells whether the law was fitted to this dataset."""
    fit = fitted_law.fit
    common: dict[str, Any] = {
        "dataset": str(evidence.path),
        "sha256": evidence.sha256,
        "section": evidence.experiment.model.specimen.section,
        "model": fit.model,
        "fit": FitReference.of(fit, fitted_law.path, fitted_law.index),
        "initial_shear_modulus": fit.initial_shear_modulus,
        "seen": seen,
        "states": evidence.used,
    }
    if misfit is None:
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
        within_fitted_stretch=_is_within(stretch, fit),
        by_state=StateError.of(evidence, misfit.error_mm[0], misfit.deviation_mm[0]),
    )


def _is_within(stretch: float, fit: FitRecord | TensileRecord | RingDownRecord) -> bool | None:
    """Return whether a stretch was reached in the data of a fit; None for ring-downs, whose stretches are unknown."""
    return None if isinstance(fit, RingDownRecord) else stretch <= fit.stretch_reached + _SAME_STRETCH
