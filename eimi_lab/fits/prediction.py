"""The service that predicts: fits and datasets in, errors with their intervals out.

`eimi validate`, the report and a notebook ask it. It works in this process or shares the work among workers, in steps:
each dataset with the fits that can be simulated together; each fit that has to be simulated alone; and the interval of
each error.
"""

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
from eimi_lab.fits.records import FitRecord, TensileRecord
from eimi_lab.fits.simulated_fit import FittedLaw, Law, Prediction, simulate_alone, simulate_each
from eimi_lab.fits.validation import Validation
from eimi_lab.process.errors import InputError
from eimi_lab.process.progress import silent
from eimi_lab.process.workers import completed


def validate(evidence: Evidence, fit: FitRecord | TensileRecord, path: Path, index: int) -> Validation:
    """Return the error of the fit ``index`` of the file ``path`` on a dataset, with its interval.

    Raises InputError when the fit was made from this very dataset under another section assumption.
    """
    (prediction,) = predict([(FittedLaw(path, index, fit), evidence)])
    return prediction.validation


def predict(fits: Sequence[tuple[Law, Evidence]]) -> Sequence[Prediction[Law]]:
    """Return the predictions of fits on one dataset, with intervals. Raises InputError as `validate` does."""
    *_, (_, predictions) = predict_on_each([fits])
    return predictions


def predict_on_each(
    datasets: Sequence[Sequence[tuple[Law, Evidence]]],
    told: Callable[[str], None] = silent,
    executor: Callable[[], AbstractContextManager[Executor]] | None = None,
    meanwhile: Callable[[], None] | None = None,
) -> Iterator[tuple[int, list[Prediction[Law]]]]:
    """Yield each dataset's place and predictions twice: once all its fits are simulated, and at last with intervals.

    Parameters
    ----------
    datasets
        For each dataset every fit, with the evidence as which that fit takes the dataset.
    told
        Is called for each fit that is simulated and for each interval.
    executor
        Whose workers share the steps; None for this process alone.
    meanwhile
        See `completed`.

    Raises
    ------
    InputError
        As `validate` does.
    """

    def next_steps(step: _Step, outcome: Any) -> list[_Step]:
        """Return what is left to do for the fits that a step simulated, or could not: the long steps first."""
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
        _Step("together", place, 0, partial(_simulate_together, fits, silent if executor else told))
        for place, fits in enumerate(datasets)
    ]
    if executor:  # what takes longest first, lest it be waited for in the end
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
            _tell(step, outcome, told)
        simulated = [prediction for prediction in predictions[step.dataset] if prediction]
        if step.kind != "interval" and len(simulated) == len(datasets[step.dataset]):
            yield step.dataset, simulated
    for place in sorted(predictions):
        yield place, [prediction for prediction in predictions[place] if prediction]


class _Step(NamedTuple):
    """All fits on a dataset together, one fit alone, or the interval of its error; dataset, fit: their places."""

    kind: Literal["together", "alone", "interval"]
    dataset: int
    fit: int
    call: Callable[[], Any]


def _called(call: Callable[[], Any]) -> Any:
    return call()


def _simulate_together(
    fits: Sequence[tuple[Law, Evidence]], told: Callable[[str], None]
) -> list[Prediction[Law] | None]:
    """Simulate what can be simulated together: the fits that take the dataset under one section assumption."""
    sections = [evidence.experiment.model.specimen.section for _, evidence in fits]
    of_section = {
        section: simulate_each(evidence, [law for (law, _), own in zip(fits, sections, strict=True) if own == section])
        for section, (_, evidence) in zip(sections, fits, strict=True)
    }
    predictions = []
    for section in sections:
        prediction = next(of_section[section])
        predictions.append(prediction)
        if prediction:
            told(prediction.in_words())
    return predictions


def _with_interval(prediction: Prediction[Law]) -> Prediction[Law]:
    """Return the prediction with the 95 % interval of its mean error, if the beam has an equilibrium."""
    if not prediction.has_equilibrium:
        return prediction
    fit, evidence = prediction.fitted_law.fit, prediction.evidence
    interval_mm = error_interval_mm(fit, evidence, prediction.residuals_mm)
    validation = prediction.validation.model_copy(update={"mean_error_interval_mm": interval_mm})
    return replace(prediction, validation=validation)


def _tell(step: _Step, outcome: Any, told: Callable[[str], None]) -> None:
    if step.kind == "interval":
        told(f"{outcome.in_words()}, its interval")
        return
    for prediction in outcome if step.kind == "together" else [outcome]:
        if prediction:
            told(prediction.in_words())


def _size(fits: Sequence[tuple[Law, Evidence]]) -> float:
    """Estimate how long a dataset takes beside others: states, and elements across a wider beam."""
    for _, evidence in fits:
        specimen = evidence.experiment.model.specimen
        return len(evidence.states) * specimen.width_mm / specimen.length_mm
    return 0.0
