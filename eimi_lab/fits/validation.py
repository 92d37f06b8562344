"""validation.json: what a fit's error is on datasets, those that it has not seen above all.

A law that finds no equilibrium in one of the states is a result, not an accident: its errors are then null and its
status says so. A law that is not Drucker-stable over the stretches it reaches is simulated all the same, and flagged.

On a dataset that it has seen, a fit keeps the nuisances that it freed (magnetic moment, roll and so on); on any other
they are as stated.

The interval of the mean error holds 95 % of what it is with the parameters of the fit's draws, and with what the
dataset itself states as uncertain (`predicted_error`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.beam.beside import FORETOLD_MM
from eimi_fitting.beam.outline import outline, points_on
from eimi_fitting.inference.considered import coarse_model
from eimi_fitting.inference.corrections import Correction, correction, polished, refinements
from eimi_fitting.inference.experiment import Comparison, Experiment, compare
from eimi_fitting.inference.measurements import EdgeObservation, Misfit
from eimi_fitting.inference.quantity import Quantity
from eimi_fitting.laws import LAWS
from eimi_lab.errors import InputError
from eimi_lab.fits.assumptions import Assumptions, assumptions_of
from eimi_lab.fits.evidence import Evidence
from eimi_lab.fits.law_record import Record
from eimi_lab.fits.predicted_error import predicted_errors_mm
from eimi_lab.fits.records import FitRecord, StateError, TensileRecord
from eimi_lab.fits.states_used import StatesUsed
from eimi_lab.outputs import whole_file
from eimi_lab.tables import data_frame, html_table

Array = NDArray[np.float64]

_SAME_STRETCH = 1e-3  # two simulations of one beam may differ by this much
_DRAWS = 16  # of the fit's, evenly over the modulus
# Of a fit's own error, or a micrometre: what depth adds to its edges is known this well. Of a fit that is hundreds of
# micrometres off one or two states then tell, and no digit that counts is theirs.
_OF_ERROR = 0.01


class FitReference(Record):
    """Which fit of which file; window_percent of a tensile fit (null: the whole curve)."""

    path: str
    index: int
    kind: Literal["bending", "bending and tensile", "tensile"]
    window_percent: float | None

    def kind_in_words(self) -> str:
        """`bending`, `bending and tensile`, `tensile 50 %` or `tensile full`."""
        if self.kind != "tensile":
            return self.kind
        return "tensile full" if self.window_percent is None else f"tensile {self.window_percent:g} %"


class Validation(Record):
    """One fit on one dataset.

    seen: the fit was made from this dataset; states: which of the dataset's were used here; stable: Drucker-stable over
    the stretches reached here (null where no equilibrium was found); within_fitted_stretch: the fit's data reached the
    largest stretch of this dataset;
    mean_error_interval_mm: see above, its upper end null where one of the draws finds no equilibrium.
    """

    dataset: str
    sha256: str
    section: str
    model: str
    fit: FitReference
    initial_shear_modulus: Quantity
    seen: bool
    states: StatesUsed
    status: Literal["ok", "no equilibrium"]
    mean_error_mm: float | None
    mean_error_interval_mm: tuple[float, float | None] | None
    mean_deviation_mm: float | None
    max_stretch: float | None
    stable: bool | None
    within_fitted_stretch: bool | None
    by_state: tuple[StateError, ...]

    def to_pandas(self) -> Any:
        """pandas.DataFrame with a row a state. Raises ImportError."""
        return data_frame([state.model_dump(exclude={"dataset"}) for state in self.by_state], "state")

    def plot(self) -> Any:
        """A matplotlib figure of the errors of the states, with bars of one deviation."""
        from eimi_lab.fits.fit_figures import drawn_errors  # matplotlib is slow to import

        own = self.by_state
        states, fields = [s.state for s in own], [s.field_mT for s in own]
        return drawn_errors(states, fields, [s.error_mm for s in own], [s.deviation_mm for s in own])

    def _repr_html_(self) -> str:
        rows = [
            (str(s.state), f"{s.field_mT:.3f}", f"{1e3 * s.error_mm:.3g}", f"{1e3 * s.deviation_mm:.3g}")
            for s in self.by_state
        ]
        mean = "" if self.mean_error_mm is None else f", mean error {1e3 * self.mean_error_mm:.3g} µm"
        seen = "seen" if self.seen else "not seen"
        caption = (
            f"{self.model}, {self.fit.kind_in_words()}, on {self.dataset} ({seen} by the fit): {self.status}{mean}"
        )
        return html_table(caption, ("state", "field, mT", "error, µm", "deviation, µm"), rows)


class ValidationFile(Record):
    """A whole validation.json."""

    validations: tuple[Validation, ...]


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


def validate(evidence: Evidence, fit: FitRecord | TensileRecord, path: Path, index: int) -> Validation:
    """The error of the fit ``index`` of the file ``path`` on a dataset. Raises InputError as `predict` does."""
    return predict(evidence, fit, path, index).validation


def predict_each(
    evidence: Evidence, fits: Sequence[tuple[Path, int, FitRecord | TensileRecord]]
) -> Iterator[Prediction]:
    """Simulate fits, each with its file and its place there, on a dataset. Raises InputError as `predict` does.

    What depth adds is much the same for fits that bend the beam alike: each begins with what was found before.
    """
    near: list[Correction] = []
    every = _planar_comparisons(evidence, [fit for _, _, fit in fits])
    for (path, index, fit), plain in zip(fits, every, strict=True):
        found = predict(evidence, fit, path, index, near, plain)
        near += [found.correction.without_shapes()] if found.correction else []
        yield found


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
        every = _compared(fits[batch[0]], own[batch[0]], values, experiment)
        found |= {i: every.take(np.array([row])) for row, i in enumerate(batch)}
    return [found[i] for i in range(len(fits))]


def predict(
    evidence: Evidence,
    fit: FitRecord | TensileRecord,
    path: Path,
    index: int,
    near: Sequence[Correction] = (),
    plain: Comparison | None = None,
) -> Prediction:
    """Simulate the fit ``index`` of the file ``path`` on a dataset and measure its error.

    near: the corrections of other fits on the same dataset; plain: of `_planar_comparisons`, where it is known.
    Raises InputError when the fit was made from this very dataset under another section assumption.
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
        return _compared(fit, own, np.array([fit.values()]), experiments[0])

    plain = plain or against([experiment])
    (due,) = refinements([experiment])
    foretold_mm = max(FORETOLD_MM, _OF_ERROR * float(plain.error_mm[0].mean()))
    # Where the planar model has no equilibrium there is none to report, whatever a better one says.
    found = None if plain.unconverged[0] else correction(due, [experiment], plain, against, near, foretold_mm)
    observed, residuals = experiment.observed, plain.misfits[0].residuals
    misfit = observed.of_residuals(residuals + found.changes[0] if found else residuals)
    model, shapes = (found.models[0], found.better.shapes[0]) if found else (experiment.model, plain.shapes[0])
    view = observed.view if isinstance(observed, EdgeObservation) else None
    solved = not plain.unconverged[0] and (section != "solid" or found is not None)
    reference = FitReference(
        path=str(path),
        index=index,
        kind=fit.fitted_to() if isinstance(fit, FitRecord) else fit.kind,
        window_percent=fit.window_percent if isinstance(fit, TensileRecord) else None,
    )
    return Prediction(
        validation=_validation(evidence, fit, reference, seen is not None, plain, misfit, solved),
        correction=found,
        edges_mm=own.as_measured(points_on(outline(model, shapes, view)[0], 6)),
        residuals_mm=np.where(misfit.weights > 0, misfit.residuals[0], np.nan),
        error_mm=misfit.error_mm[0],
        deviation_mm=misfit.deviation_mm[0],
    )


def _compared(
    fit: FitRecord | TensileRecord,
    beside: Assumptions,
    parameters: Array,
    experiment: Experiment,
    keep: bool = False,
) -> Comparison:
    return compare(
        LAWS[fit.model],
        parameters,
        [experiment],
        bulk_modulus_Pa=beside.bulk_modulus_Pa,
        setups=[beside.setup] if beside.setup else None,
        keep=keep,
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
        mean_error_interval_mm=_error_interval(fit, evidence, misfit),
        mean_deviation_mm=float(misfit.deviation_mm[0].mean()),
        max_stretch=stretch,
        stable=not plain.unstable[0],
        within_fitted_stretch=stretch <= fit.max_stretch + _SAME_STRETCH,
        by_state=StateError.of(evidence, misfit.error_mm[0], misfit.deviation_mm[0]),
    )


def _error_interval(
    fit: FitRecord | TensileRecord, evidence: Evidence, misfit: Misfit
) -> tuple[float, float | None] | None:
    """95 % of the mean errors of some draws, and that of the fit itself; none without draws.

    The draws bend on the coarse mesh, from where the fit does there: what better models change in one, misfit, they
    change in the others. No upper end where one of the draws has no equilibrium.
    """
    candidates = np.concatenate([[fit.values()], fit.drawn(_DRAWS)])
    coarse = replace(evidence.experiment, model=coarse_model(evidence.experiment.model.specimen))
    every = _compared(fit, assumptions_of(fit, evidence, len(candidates)), candidates, coarse, keep=True)
    bent, sound = every.misfits[0].residuals, ~every.unconverged
    drawn = coarse.observed.of_residuals(misfit.residuals + bent - bent[:1])
    errors_mm = predicted_errors_mm(fit, evidence, drawn, every.shapes[0].every)[:, sound[1:] & sound[0]]
    if not errors_mm.size:
        return None
    low, high = np.quantile(errors_mm, [0.025, 0.975]).tolist()
    mean = float(misfit.error_mm[0].mean())
    return min(low, mean), max(high, mean) if sound.all() else None


def write_validation(path: Path, validations: Sequence[Validation], force: bool = False) -> ValidationFile:
    """Write validation.json and return what it holds. Raises InputError when it exists and not ``force``."""
    content = ValidationFile(validations=tuple(validations))
    with whole_file(path, force) as temporary:
        temporary.write_text(content.model_dump_json(indent=1) + "\n", encoding="utf-8")
    return content
