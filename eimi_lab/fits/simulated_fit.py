"""A fit simulated on a dataset, which the fit was made from or not, and its error there.

On a dataset that it was made from, a fit keeps the nuisances that it freed (magnetic moment, roll and so on); on any
other dataset they are as stated. `prediction` adds the interval of the error and shares the work among processes.
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
from eimi_lab.fits.records import FitRecord, StateError, TensileRecord
from eimi_lab.fits.validation import FitReference, Validation
from eimi_lab.process.errors import InputError

Array = NDArray[np.float64]

_SAME_STRETCH = 1e-3  # two simulations of one beam may differ by this much
# Of a fit's own error, or a micrometre: what depth adds to its edges is known this well. Of a fit that is hundreds of
# micrometres off one or two states then tell, and no digit that counts is theirs.
_OF_ERROR = 0.01


@dataclass(frozen=True)
class FittedLaw:
    """A fit with its file and its place there. Two with the same file and place are equal."""

    path: Path
    index: int
    fit: FitRecord | TensileRecord = field(compare=False)

    @property
    def label(self) -> str:
        """What progress calls it: `fits.json, fits.0`."""
        return f"{self.path}, fits.{self.index}"


Law = TypeVar("Law", bound=FittedLaw)


@dataclass(frozen=True)
class Prediction(Generic[Law]):
    """A fit simulated on a dataset of K states, and what that is worth.

    edges_mm: (K, 2, n, 2) simulated left and right edges as the camera has them, by the better model where there is
    one; residuals_mm: (K, 2, m) signed distances of the measured edge points or components of tracked points, NaN
    where nothing was observed; error_mm, deviation_mm: (K,). They are empty where the validation's status is not "ok".
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
        """Whether the beam has an equilibrium in all states."""
        return self.validation.status == "ok"

    def in_words(self) -> str:
        """Name the dataset and the fit."""
        return f"{self.evidence.path.name}, {self.fitted_law.label}"


def simulate_each(evidence: Evidence, laws: Sequence[Law]) -> Iterator[Prediction[Law] | None]:
    """Simulate several fits together, which costs less; None for a fit that `simulate_alone` has to simulate.

    What depth adds is much the same for fits that bend the beam alike: each begins with what was found before. Where
    it is large a solid has to be followed through all states, which takes long and tells nothing of the other fits.
    Raises InputError for a fit that was made from this very dataset under another section assumption.
    """
    near: list[Correction] = []
    for fitted_law, plain in zip(laws, _planar_comparisons(evidence, [own.fit for own in laws]), strict=True):
        prediction, depth = _simulated(evidence, fitted_law, near, plain, "interpolate")
        near += [depth.without_shapes()] if depth else []
        yield prediction


def simulate_alone(evidence: Evidence, fitted_law: Law) -> Prediction[Law]:
    """Simulate a fit for which `simulate_each` yielded None. Raises InputError as that does."""
    (plain,) = _planar_comparisons(evidence, [fitted_law.fit])
    prediction, _ = _simulated(evidence, fitted_law, (), plain, "follow")
    assert prediction
    return prediction


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
    evidence: Evidence, fitted_law: Law, near: Sequence[Correction], plain: Comparison, method: Method
) -> tuple[Prediction[Law] | None, Correction | None]:
    """Return the prediction, and the correction by the better model.

    near: the corrections of other fits on the same dataset; plain: of `_planar_comparisons`; method: how a
    solid is solved. No prediction is returned if "interpolate" fails.
    """
    fit, path, index = fitted_law.fit, fitted_law.path, fitted_law.index
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

    options = SolidOptions(method, max(ACCURACY_MM, _OF_ERROR * float(plain.error_mm[0].mean())))
    better = by_better_model(experiment, plain, against, near, options)
    if better is None and method == "interpolate" and not plain.unconverged[0]:
        return None, None
    misfit, curves, found = better or (None, None, None)
    validation = _validation(evidence, fitted_law, seen is not None, plain, misfit)
    if misfit is None or curves is None:
        nothing = np.zeros(0)
        return Prediction(fitted_law, evidence, validation, nothing, nothing, nothing, nothing), None
    prediction = Prediction(
        fitted_law,
        evidence,
        validation,
        edges_mm=own.as_measured(points_on(curves, 6)),
        residuals_mm=np.where(misfit.weights > 0, misfit.residuals[0], np.nan),
        error_mm=misfit.error_mm[0],
        deviation_mm=misfit.deviation_mm[0],
    )
    return prediction, found


def _validation(
    evidence: Evidence, fitted_law: FittedLaw, seen: bool, plain: Comparison, misfit: Misfit | None
) -> Validation:
    """plain: of the fit on the planar mesh; misfit: by the better model, None without an equilibrium."""
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
