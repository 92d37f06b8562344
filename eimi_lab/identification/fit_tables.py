"""Fits as tables: what a notebook shows of one, and data frames of its parameters or of several fits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from eimi_lab.tables import data_frame, html_table

if TYPE_CHECKING:  # the records show themselves through this module
    from eimi_lab.identification.records import LawRecord


def fit_html(fit: LawRecord, notes: Sequence[str]) -> str:
    """Law, parameters and initial shear modulus with their intervals, and what the fit is worth in notes."""
    quantities = {**fit.parameters, "initial shear modulus": fit.initial_shear_modulus}
    rows = [
        (name, f"{q.value + 0.0:.5g}", f"{q.interval_95[0] + 0.0:.5g} to {q.interval_95[1] + 0.0:.5g}", q.unit)
        for name, q in quantities.items()
    ]
    limit, checked = fit.stability.stable_up_to_stretch, fit.stability.checked_up_to_stretch
    stable = f"up to {checked:g}, as far as it was checked" if limit is None else f"up to {limit:.3g} only"
    stretch = f"Largest stretch in the data {fit.max_stretch:.3f}; {fit.stability.criterion}-stable {stable}."
    return html_table(fit.model, ("", "value", "95 %", "unit"), rows, (*notes, stretch))


def parameters_frame(fit: LawRecord) -> Any:
    """pandas.DataFrame: a row a parameter and one for the initial shear modulus. Raises ImportError."""
    quantities = {**fit.parameters, "initial_shear_modulus": fit.initial_shear_modulus}
    rows = [
        {"parameter": name, "value": q.value, "low_95": q.interval_95[0], "high_95": q.interval_95[1], "unit": q.unit}
        for name, q in quantities.items()
    ]
    return data_frame(rows, "parameter")
