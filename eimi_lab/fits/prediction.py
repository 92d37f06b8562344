"""Compute how far fitted laws are from the edges of datasets, with intervals, in one or several processes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple

from eimi_lab.fits.evidence import Evidence
from eimi_lab.fits.predicted_error import error_interval_mm
from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.simulated_fit import FittedLaw, Law, Prediction, simulate_alone, simulate_each
from eimi_lab.fits.tensile_record import TensileRecord
from eimi_lab.fits.time_records import RingDownRecord
from eimi_lab.fits.validation import Validation
from eimi_lab.process.errors import InputError
from eimi_lab.process.progress import silent
from eimi_lab.process.workers import completed


def validate(evidence: Evidence, fit: FitRecord | TensileRecord | RingDownRecord, path: Path, index: int) -> Validation:
    """Return the errors of a fit on a dataset, with the 95 % interval of the mean error.

    Parameters
    ----------
    evidence : Evidence
        Dataset.
    fit : FitRecord or TensileRecord or RingDownRecord
        Fit.
    path : Path
        File of the fit.
    index : int
        Index of the fit in the file.

    Raises
    ------
    InputError
        If the law was fitted to this dataset with another model of the cross-section.
    """
    (prediction,) = predict([(FittedLaw(path, index, fit), evidence)])
    return prediction.validation


def predict(fits: Sequence[tuple[Law, Evidence]]) -> Sequence[Prediction[Law]]:
    """Simulate one dataset with each of several fitted laws, with the 95 % intervals of the errors.

    `fits` holds a pair of fitted law and dataset for each fit. Raises InputError if a law was fitted to this dataset
    with another model of the cross-section.
    """
    *_, (_, predictions) = predict_on_each([fits])
    return predictions


def predict_on_each(
    datasets: Sequence[Sequence[tuple[Law, Evidence]]],
    step_done: Callable[[str], None] = silent,
    executor: Callable[[], AbstractContextManager[Executor]] | None = None,
    meanwhile: Callable[[], None] | None = None,
) -> Iterator[tuple[int, list[Prediction[Law]]]]:
    """Predict the errors of fits on several datasets: first without, later with intervals.

    Parameters
    ----------
    datasets : sequence
        For each dataset, the pairs of a fit and the dataset.
    step_done : callable
        Called with a line of text after each step.
    executor : callable, optional
        Starts worker processes; by default this process does all steps.
    meanwhile : callable, optional
        Called once while the workers compute.

    Yields
    ------
    place : int
        Index of a dataset, once without and once with intervals.
    predictions : list of Prediction
        Predictions of all fits on this dataset.

    Raises
    ------
    InputError
        If a law was fitted to a dataset with another model of the cross-section.
    """

    def next_steps(step: _Step, outcome: Any) -> list[_Step]:
        """Return the steps of the computation that follow `step`, whose result is `outcome`."""
        if step.kind == "interval":
            return []
        alone, intervals = list[_Step](), list[_Step]()
        for fit, prediction in enumerate(outcome) if step.kind == "together" else [(step.fit, outcome)]:
            if prediction is None:
                fitted_law, evidence = datasets[step.dataset][fit]
                alone.append(_Step("alone", step.dataset, fit, partial(simulate_alone, evidence, fitted_law)))
            else:
                intervals.append(_Step("interval", step.dataset, fit, partial(_with_interval, prediction)))
        return alone + intervals

    first = [
        _Step("together", place, 0, partial(_simulate_together, fits, silent if executor else step_done))
        for place, fits in enumerate(datasets)
    ]
    if executor:  # begin with the longest steps, so that the workers finish at about the same time
        first.sort(key=lambda step: -_size(datasets[step.dataset]))
    predictions: dict[int, list[Prediction[Law] | None]] = {}
    steps = completed(_called, lambda step: {"call": step.call}, first, executor, (InputError,), meanwhile, next_steps)
    for step, result in steps:
        outcome = result()
        if step.kind == "together":
            predictions[step.dataset] = outcome
        else:
            predictions[step.dataset][step.fit] = outcome
        if step.kind != "together" or executor:
            _report(step, outcome, step_done)
        simulated = [prediction for prediction in predictions[step.dataset] if prediction]
        if step.kind != "interval" and len(simulated) == len(datasets[step.dataset]):
            yield step.dataset, simulated
    for place in sorted(predictions):
        yield place, [prediction for prediction in predictions[place] if prediction]


class _Step(NamedTuple):
    """One task for a worker process: the simulation of a dataset, or the computation of an interval."""

    kind: Literal["together", "alone", "interval"]
    dataset: int
    fit: int
    call: Callable[[], Any]


def _called(call: Callable[[], Any]) -> Any:
    return call()


def _simulate_together(
    fits: Sequence[tuple[Law, Evidence]], step_done: Callable[[str], None]
) -> list[Prediction[Law] | None]:
    """Simulate several fits on one dataset; None for a fit that has to be simulated alone."""
    sections = [evidence.experiment.model.specimen.section for _, evidence in fits]
    of_section = {
        section: simulate_each(evidence, [law for (law, _), s in zip(fits, sections, strict=True) if s == section])
        for section, (_, evidence) in zip(sections, fits, strict=True)
    }
    predictions = []
    for section in sections:
        prediction = next(of_section[section])
        predictions.append(prediction)
        if prediction:
            step_done(prediction.in_words())
    return predictions


def _with_interval(prediction: Prediction[Law]) -> Prediction[Law]:
    if not prediction.has_equilibrium:
        return prediction
    fit, evidence = prediction.fitted_law.fit, prediction.evidence
    interval_mm = error_interval_mm(fit, evidence, prediction.residuals_mm)
    validation = prediction.validation.model_copy(update={"mean_error_interval_mm": interval_mm})
    return replace(prediction, validation=validation)


def _report(step: _Step, outcome: Any, step_done: Callable[[str], None]) -> None:
    if step.kind == "interval":
        step_done(f"{outcome.in_words()}, interval of its mean error")
        return
    for prediction in outcome if step.kind == "together" else [outcome]:
        if prediction:
            step_done(prediction.in_words())


def _size(fits: Sequence[tuple[Law, Evidence]]) -> float:
    """Return a number that is roughly proportional to the time for the simulation of a dataset."""
    for _, evidence in fits:
        specimen = evidence.experiment.model.specimen
        return len(evidence.states) * specimen.width_mm / specimen.length_mm
    return 0.0
