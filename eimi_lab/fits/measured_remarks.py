"""Sentences on the measured field and on the measured temperature of datasets that are fitted."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from eimi_lab.fits.evidence import Evidence

DIFFERENT_K = 2.0
"""Datasets that are fitted together and whose specimens differ by more than this are reported."""


def measured_field_remark(evidence: Evidence) -> str | None:
    """Return a sentence on the measured field that a fit uses; None if the field follows from the current."""
    line = evidence.field_line
    if line is None:
        return None
    typed = evidence.typed_mT_per_A
    percent = "" if typed is None else f" ({100 * (line.mT_per_A / typed - 1):+.1f} %)"
    exact = "" if line.shared_is_stated else "; its scale is taken as exact, because no uncertainty_share is stated"
    return (
        f"{evidence.path}: the field is the one that {line.probe} measured at {line.currents} currents, "
        f"{line.in_words}, in place of coil_constant_mT_per_A = {typed:g}{percent}{exact}"
    )


def temperature_remark(evidence: Evidence) -> str | None:
    """Return a sentence on the measured temperature of the specimen; None if it was not measured."""
    temperatures = _temperatures(evidence)
    if not temperatures:
        return None
    span = f", from {min(temperatures):.1f} to {max(temperatures):.1f}" if len(temperatures) > 1 else ""
    return f"{evidence.path}: the specimen was at {np.mean(temperatures):.1f} °C{span}"


def temperature_differences(evidence: Sequence[Evidence]) -> list[str]:
    """Return a line for each two datasets whose specimens differ by more than `DIFFERENT_K`."""
    means = [(one.path, float(np.mean(_temperatures(one)))) for one in evidence if _temperatures(one)]
    return [
        f"{first} was measured at {first_degC:.1f} °C and {second} at {second_degC:.1f} °C: they differ by more than "
        f"{DIFFERENT_K:g} K, and the fit takes the material as the same"
        for (first, first_degC), (second, second_degC) in combinations(means, 2)
        if abs(first_degC - second_degC) > DIFFERENT_K
    ]


def _temperatures(evidence: Evidence) -> list[float]:
    return [state.temperature_degC for state in evidence.states if state.temperature_degC is not None]
