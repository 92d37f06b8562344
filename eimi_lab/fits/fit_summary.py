"""The details of a fit and the comparison of laws, as `eimi fit` prints them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eimi_fitting.inference.doubts.causes import NONE
from eimi_fitting.inference.evidence.quantity import Quantity
from eimi_fitting.inference.interval.budget import BudgetEntry
from eimi_fitting.inference.planning.choice_of_law import Choice
from eimi_fitting.laws.search_space import BULK_NAME
from eimi_lab.fits.assumptions import compressibility_remark, rest_shape_remark, section_remark
from eimi_lab.fits.evidence import WHOLE_FILES, Evidence
from eimi_lab.fits.grades import grade
from eimi_lab.fits.law_record import LawRecord
from eimi_lab.fits.measured_remarks import (
    heating_remark,
    measured_differences,
    measured_field_remark,
    temperature_remark,
)
from eimi_lab.fits.records import DatasetReference, FitRecord
from eimi_lab.fits.tensile_record import TensileRecord
from eimi_lab.showing.significant import significant

_LARGEST = 5  # each of the five largest sources has its own line; all smaller sources share one line


def remarks(fit: FitRecord) -> list[str]:
    """Return lines about one fit: its uncertainties, what the data determine, the verdict and the warnings."""
    lines = [*what_is_fixed(fit), *budget_lines(fit), *what_was_fitted_beside(fit), *cause_lines(fit)]
    return [*lines, *_grade_lines(fit), *_doubts(fit)]


def _grade_lines(fit: FitRecord) -> list[str]:
    """Return a line with the grade of a fit: how well data and checks support the fit."""
    support = grade(fit)
    return [f"verdict: {support.name}" + ("" if fit.doubts_in_words() else f". {support.words}")]


def cause_lines(fit: FitRecord) -> list[str]:
    """Return a line with the two most probable causes of the residuals, such as a tilted camera.

    The list is empty if no causes were compared.
    """
    within = "within the stated uncertainty, "
    words = [
        "no listed cause"
        if cause.name == NONE
        else f"{cause.name} {signed(cause.value, cause.unit)} ({within * cause.is_within_stated}changes the modulus by "
        f"{cause.shift_percent:+.2g} %)"
        for cause in fit.causes[:2]
    ]
    shown = [f"{w}, probability {c.probability:.2g}" for w, c in zip(words, fit.causes, strict=False)]
    return [f"causes of the residuals: {'; '.join(shown)}"] if shown else []


def what_is_fixed(fit: FitRecord) -> list[str]:
    """Return lines on the parameters that the data of a fit determine, and on the bulk modulus if it was fitted."""
    lines = [fit.identifiability.statement]
    if fit.bulk_modulus:
        value, low, high = (
            significant(1e-3 * number, 4) for number in (fit.bulk_modulus.value, *fit.bulk_modulus.interval_95)
        )
        open_end = BULK_NAME in fit.identifiability.not_fixed
        lines.append(
            f"bulk modulus {value} [{low}, {high}] kPa"
            + ("; the data agree with an infinite bulk modulus" if open_end else "")
        )
    return lines


def what_was_fitted_beside(fit: FitRecord) -> list[str]:
    """Return lines on priors, fitted uncertain inputs and tensile curves of a fit."""
    lines = fit.priors_in_words()
    for value in fit.freed:
        lines.append(
            f"{value.name}: fitted deviation from the given value {_deviation(value.deviation)}, prior standard "
            f"deviation {_scaled(value.prior_standard_deviation, value.deviation.unit)}"
        )
    for curve in fit.tensile:
        lines.append(
            f"{curve.name}: RMSE {_kPa(curve.rmse_Pa)} kPa, or {_kPa(curve.rmse_alone_Pa)} kPa if the law is fitted "
            f"to this curve alone (weight {curve.weight:g}, {curve.rows} rows that count as "
            f"{curve.rows / curve.correlation_rows:.1f} independent rows)"
        )
    return lines


def _doubts(fit: LawRecord) -> list[str]:
    return [f"doubt: {words}" for words in fit.doubts_in_words()]


def tensile_remarks(fit: TensileRecord) -> list[str]:
    """Return lines on a fit to a tensile test: undetermined parameters, and reasons to distrust the fit."""
    return [*fit.not_fixed_in_words(), *_doubts(fit)]


def evidence_remarks(evidence: Sequence[Evidence]) -> list[str]:
    """Return lines on the datasets of a fit: cross-section, shape at rest, compressibility, field and temperatures."""
    remarks_of = (
        section_remark,
        rest_shape_remark,
        compressibility_remark,
        measured_field_remark,
        temperature_remark,
        heating_remark,
    )
    remarks = [remark for one in evidence for say in remarks_of if (remark := say(one))]
    return [*remarks, *measured_differences([DatasetReference.of(one) for one in evidence])]


def budget_lines(fit: FitRecord) -> list[str]:
    """Return lines on the sources of uncertainty of the modulus, the largest first."""
    modulus, lines = fit.initial_shear_modulus, []
    for entry in fit.budget[:_LARGEST]:
        effect = f"± {_percent(entry.effect_percent)} of the modulus"
        lines.append(f"{entry_words(entry, fit)} ± {_scaled(entry.standard_uncertainty, entry.unit)}: {effect}")
    smaller = [entry.effect_percent for entry in fit.budget[_LARGEST:]]
    if smaller:
        together = float(np.sqrt(np.sum(np.square(smaller))))
        lines.append(f"{len(smaller)} smaller sources together: ± {_percent(together)} of the modulus")
    if len(fit.budget) > 1:
        lines.append(
            f"all {len(fit.budget)} sources together: ± {_percent(all_together_percent(fit))} of the modulus "
            "(standard uncertainty; the 95 % interval is ± twice this value)"
        )
    if modulus.interval_95_fit and fit.budget:
        low, high = modulus.interval_95_fit
        lines.append(f"95 % interval from noise and mesh error alone: [{low:.0f}, {high:.0f}] Pa")
    keys = [word for word in fit.taken_as_exact if word not in WHOLE_FILES]
    if keys:
        lines.append(f"taken as exact, because no uncertainty is given: {', '.join(keys)}")
    return [*lines, next_sentence(fit)] if fit.budget else lines


def all_together_percent(fit: FitRecord) -> float:
    """Return the standard uncertainty of the modulus due to all sources together, in per cent."""
    return float(np.sqrt(sum(entry.effect_percent**2 for entry in fit.budget)))


def entry_words(entry: BudgetEntry, fit: FitRecord) -> str:
    """Return the name of a source of uncertainty, with the datasets that it concerns."""
    if len(entry.datasets) == len(fit.datasets):
        return entry.words
    return f"{entry.words} of {', '.join(fit.datasets[d].path for d in entry.datasets)}"


def next_sentence(fit: FitRecord) -> str:
    """Return a sentence on the quantity to measure better next, and on the resulting interval of the modulus."""
    low, high = fit.measure_next.initial_shear_modulus_interval_95_Pa
    interval = f"the interval would be [{low:.0f}, {high:.0f}] Pa"
    if fit.measure_next.source is None:
        return f"Noise and mesh limit this interval. With about four times as many states {interval}."
    return f"Measure better next: {fit.measure_next.words}. With half of this uncertainty {interval}."


def _percent(value: float) -> str:
    return f"{value:.2g} %"


def comparison_table(choices: Sequence[Choice]) -> list[str]:
    """Return the lines of a table that compares laws; empty if the laws were not fitted to the same data."""
    if not choices:
        return []
    lines = ["law              unknowns    AICc     BIC   weight   error on states left out"]
    for choice in choices:
        aicc = "too few" if choice.aicc is None else f"{choice.aicc:7.1f}"
        weight = "-" if choice.weight is None else f"{choice.weight:.3f}"
        left_out = held_out_in_words(choice)
        lines.append(f"{choice.model:16s} {choice.unknowns:8d} {aicc} {choice.bic:7.1f} {weight:>8s}   {left_out}")
    return [*lines, points_in_words(choices), *too_few_in_words(choices)]


def held_out_in_words(choice: Choice) -> str:
    """Return the error of a law on states left out of its fit (µm) as text; `-` if no state could be left out."""
    return "-" if choice.held_out_error_mm is None else f"{1e3 * choice.held_out_error_mm:.2f} µm"


def points_in_words(choices: Sequence[Choice]) -> str:
    """Return a sentence on the number of independent points that the information criteria AICc and BIC assume."""
    return (
        f"AICc and BIC count the data as {choices[0].independent_points:.1f} independent points, estimated from the "
        f"correlation of the residuals of the law that fits best."
    )


def too_few_in_words(choices: Sequence[Choice]) -> list[str]:
    """Return a sentence on the laws without the criterion AICc, for which there are too few data.

    The list is empty if all laws have an AICc.
    """
    without_aicc = [choice.model for choice in choices if choice.aicc is None]
    if not without_aicc:
        return []
    has_weights = any(choice.weight is not None for choice in choices)
    weights = "the weights compare only the other laws" if has_weights else "there are no weights"
    return [
        f"These points are too few for an AICc of {', '.join(without_aicc)}. AICc needs two more points than unknowns, "
        f"and the level of the noise counts as an unknown; {weights}."
    ]


def _kPa(pascal: float) -> str:
    return f"{1e-3 * pascal:.4g}"


def signed(value: float, unit: str) -> str:
    """Return a deviation with sign and unit as text; in per cent if the unit is "1"."""
    return f"{significant(100 * value, 2, '+')} %" if unit == "1" else f"{significant(value, 2, '+')} {unit}"


def _scaled(value: float, unit: str) -> str:
    return f"{100 * value:.3g} %" if unit == "1" else f"{value:.3g} {unit}"


def _deviation(quantity: Quantity) -> str:
    low, high = (_scaled(end, quantity.unit) for end in quantity.interval_95)
    return f"{_scaled(quantity.value, quantity.unit)} [{low}, {high}]"
