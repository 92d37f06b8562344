"""Simulate the edges of a dataset with a fitted law, and compute the error of these edges.

If the law was fitted to this dataset, the uncertain inputs that were fitted with the law (freed nuisances, such as the
magnetic moment) keep their identified values. On any other dataset these inputs have the values in the input files. The
module `prediction` adds the interval of the error and shares the work among processes.
"""

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
    """A fit, the result file that contains the fit, and the index of the fit in this file.

    Two objects are equal if their files and indices are equal.
    """

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
    """The simulation of a fit on a dataset with K used states. All arrays are empty if the beam has no equilibrium.

    Attributes
    ----------
    fitted_law : FittedLaw
        The fit, with its file.
    evidence : Evidence
        The dataset, with its beam model and loads.
    validation : Validation
        The errors of the fit on the dataset.
    edges_mm : ndarray, shape (K, 2, n, 2)
        x and y of n points of the simulated left and right edges as the camera sees them. The axes are state, edge,
        point and coordinate. The edges belong to the most accurate beam model that was solved.
    residuals_mm : ndarray, shape (K, 2, m)
        Signed distances of the m measured edge points from the simulated edges; the axes are state, edge and point. For
        tracked points, the second axis holds the x and y components of the distance. NaN where no point was measured.
    error_mm, deviation_mm : ndarray, shape (K,)
        Root mean square and standard deviation of the distances in each state, mm.
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
    """Simulate several fits on a dataset together, which takes less time than separate simulations.

    Each fit is first simulated with a planar beam model. A better beam model then corrects the result: a planar model
    with a finer mesh or, for the section "solid", a three-dimensional model. To save time, the three-dimensional model
    is solved in a few states only, and the correction of the other states is interpolated. The solution starts from the
    corrections of the previous fits, because similar fits have similar corrections.

    If the interpolation is not accurate enough for a fit, the three-dimensional model has to be solved in all states.
    The function yields None for this fit, and `simulate_alone` simulates it.

    Parameters
    ----------
    evidence : Evidence
        The dataset, with its beam model, loads and measured edges.
    laws : sequence of FittedLaw
        The fits, each with its file.

    Yields
    ------
    Prediction or None
        The prediction of each fit; None for a fit that `simulate_alone` has to simulate.

    Raises
    ------
    InputError
        If a law was fitted to this dataset with another model of the cross-section.
    """
    near: list[Correction] = []
    for fitted_law, plain in zip(laws, _planar_comparisons(evidence, [law.fit for law in laws]), strict=True):
        prediction, depth = _simulated(evidence, fitted_law, near, plain, "interpolate")
        near += [depth.without_shapes()] if depth else []
        yield prediction


def simulate_alone(evidence: Evidence, fitted_law: Law) -> Prediction[Law]:
    """Simulate one fit on a dataset, with the most accurate beam model solved in all states.

    This takes longer than `simulate_each`, whose interpolation between a few states is not accurate enough for some
    fits. Raises InputError if the law was fitted to this dataset with another model of the cross-section.
    """
    (plain,) = _planar_comparisons(evidence, [fitted_law.fit])
    prediction, _ = _simulated(evidence, fitted_law, (), plain, "follow")
    assert prediction
    return prediction


def _planar_comparisons(
    evidence: Evidence, fits: Sequence[FitRecord | TensileRecord | RingDownRecord]
) -> list[Comparison]:
    """Return the comparison of a dataset with the planar simulation of each fit, in the order of the fits.

    The simulations are not yet corrected for the depth of the beam. To save time, the fits of one law are simulated as
    one batch. A fit with a bulk modulus, or with uncertain inputs that were fitted together with the law, is simulated
    separately.
    """
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
    """Return the simulation of a fit with the most accurate beam model, and how this model changed the edges.

    The change (correction) is the difference between a model with a solid cross-section and a planar model. Both
    results are None if the method "interpolate" is not accurate enough.

    Parameters
    ----------
    evidence : Evidence
        The dataset, with its beam model, loads and measured edges.
    fitted_law : FittedLaw
        The fit, with its file.
    near : sequence of Correction
        Corrections of other fits on the same dataset, as a starting point.
    plain : Comparison
        Comparison of the dataset with the planar simulation of the fit, from `_planar_comparisons`.
    method : {"interpolate", "follow"}
        Whether to interpolate the correction between a few solved states, or to solve the beam model with a solid
        section in all states.
    """
    fit, path, index = fitted_law.fit, fitted_law.path, fitted_law.index
    section = evidence.experiment.model.specimen.section
    used = {reference.sha256: reference for reference in fit.datasets} if isinstance(fit, FitRecord) else {}
    reference = used.get(evidence.sha256)
    if reference is not None and reference.section != section:
        raise InputError(
            f"{path}: fits.{index} was fitted to {evidence.path} with the section {reference.section}, not {section}; "
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
    """Return the errors of a fit on a dataset: root mean square distances between measured and simulated points.

    `seen` tells whether the law was fitted to this dataset. `misfit` contains the distances for the most accurate beam
    model; None if the beam has no equilibrium. Stretch and stability come from the planar simulation `plain`.
    """
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
        within_fitted_stretch=stretch <= fit.max_stretch + _SAME_STRETCH,
        by_state=StateError.of(evidence, misfit.error_mm[0], misfit.deviation_mm[0]),
    )
