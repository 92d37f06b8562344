"""Read the fits of a result file for the live web page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from eimi_lab.fits.fits_file import read_fits_file
from eimi_lab.fits.records import FitRecord
from eimi_lab.showing.rounded import value_and_interval

MOST_BUDGET = 6


def summaries(path: Path) -> list[dict[str, Any]]:
    """Return a summary of each fit of a bent beam in a result file, as JSON objects.

    A summary contains the modulus and the parameters of the law with their 95 % intervals, the error at every load
    step, the contributions to the uncertainty, and the reasons to distrust the result.

    Raises
    ------
    InputError
        If the file is not a result file.
    """
    return [_summary(fit) for fit in read_fits_file(path).fits if isinstance(fit, FitRecord)]


def _summary(fit: FitRecord) -> dict[str, Any]:
    modulus = fit.initial_shear_modulus
    value, interval = value_and_interval(modulus)
    return {
        "model": fit.model,
        "modulus": [modulus.value, modulus.unit, *(modulus.interval_95 or (None, None))],
        "summary": fit.summary(f"{value} (95 % interval: {interval})"),
        "parameters": {
            name: [quantity.value, quantity.unit, *(quantity.interval_95 or (None, None))]
            for name, quantity in fit.parameters.items()
        },
        "notes": fit.notes(),
        "doubts": fit.doubts_in_words(),
        "by_state": [[state.field_mT, 1e3 * state.error_mm] for state in fit.by_state],
        "budget": [[entry.source, entry.effect_percent] for entry in fit.budget[:MOST_BUDGET]],
        "generations": [[number, one.best_mm, one.mean_mm] for number, one in enumerate(fit.history, 1)],
    }
