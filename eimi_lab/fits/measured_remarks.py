"""Sentences on measured fields and temperatures of datasets."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from eimi_lab.fits.evidence import Evidence
from eimi_lab.fits.measured_record import MeasuredField, MeasuredTemperature
from eimi_lab.fits.records import DatasetReference

DIFFERENT_K = 2.0
"""Difference of the specimens' temperatures (K) above which two datasets of one fit are reported as different."""

DIFFERENT_SIGMA = 3.0
"""Difference of two measured coil constants, in standard uncertainties, above which the difference is reported."""


def measured_field_remark(evidence: Evidence) -> str | None:
    """Return a sentence on the measured field; None if the field was not measured."""
    measured = MeasuredField.of(evidence)
    return None if measured is None else f"{evidence.path}: the fit uses the field that {measured.in_words}"


def temperature_remark(evidence: Evidence) -> str | None:
    """Return a sentence on the measured temperature of the specimen; None if it was not measured."""
    measured = MeasuredTemperature.of(evidence)
    return None if measured is None else f"{evidence.path}: the specimen was at {measured.in_words}"


def heating_remark(evidence: Evidence) -> str | None:
    """Return a sentence on the measured temperature of the coil; None if it was not measured."""
    return None if evidence.heating is None else f"{evidence.path}: the coil was at {evidence.heating.in_words}"


def measured_lines(datasets: Sequence[DatasetReference]) -> list[str]:
    """Return the lines on the measured field and temperature of the datasets of a fit, and on their differences."""
    measured = [(d.path, d.measured_field) for d in datasets if d.measured_field]
    fields = [f"{path}: the fit uses the field that {field.in_words}" for path, field in measured]
    warm = [f"{d.path}: the specimen was at {d.temperature.in_words}" for d in datasets if d.temperature]
    return [*fields, *warm, *measured_differences(datasets)]


def measured_differences(datasets: Sequence[DatasetReference]) -> list[str]:
    """Return a line for each pair of datasets whose temperatures or measured coil constants differ."""
    lines = []
    for first, second in combinations(datasets, 2):
        if first.temperature and second.temperature:
            one, other = first.temperature.mean_degC, second.temperature.mean_degC
            if abs(one - other) > DIFFERENT_K:
                lines.append(
                    f"{first.path} was measured at {one:.1f} °C and {second.path} at {other:.1f} °C: they differ by "
                    f"more than {DIFFERENT_K:g} K, but the fit assumes equal materials"
                )
        if first.measured_field and second.measured_field:
            lines += _field_difference(first, first.measured_field, second, second.measured_field)
    return lines


def _field_difference(
    first: DatasetReference, one: MeasuredField, second: DatasetReference, other: MeasuredField
) -> list[str]:
    difference = other.mT_per_A - one.mT_per_A
    sigma = float(np.hypot(one.mT_per_A_sigma, other.mT_per_A_sigma))
    if abs(difference) <= DIFFERENT_SIGMA * sigma:
        return []
    return [
        f"{first.path} has {one.mT_per_A:.5g} mT/A and {second.path} has {other.mT_per_A:.5g} mT/A: they differ by "
        f"{100 * difference / one.mT_per_A:+.1f} %, more than {DIFFERENT_SIGMA:g} standard uncertainties; is it the "
        "same coil, with the probe at the same place?"
    ]
