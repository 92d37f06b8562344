"""What `eimi fit` prints under its result lines."""

from __future__ import annotations

from collections.abc import Sequence

from eimi_fitting.search_space import BULK_NAME
from eimi_lab.identification.fits import comparison
from eimi_lab.identification.records import FitRecord, Quantity

_CONTRADICTS = 3.0  # times the misfit of the curve alone: as unlikely as three standard deviations are


def remarks(fit: FitRecord) -> list[str]:
    """Lines on one fit: what the data fix, what was freed, tensile curves, doubts."""
    lines = [fit.identifiability.statement]
    if fit.bulk_modulus:
        low, high = fit.bulk_modulus.interval_95
        open_end = BULK_NAME in fit.identifiability.not_fixed
        lines.append(
            f"bulk modulus {_kPa(fit.bulk_modulus.value)} [{_kPa(low)}, {_kPa(high)}] kPa"
            + ("; bending does not tell it from an infinite one" if open_end else "")
        )
    for value in fit.freed:
        lines.append(
            f"{value.name} off by {_deviation(value.deviation)}, "
            f"prior standard deviation {_scaled(value.prior_standard_deviation, value.deviation.unit)}"
        )
    for curve in fit.tensile:
        lines.append(
            f"{curve.path}: RMSE {_kPa(curve.rmse_Pa)} kPa, {_kPa(curve.rmse_alone_Pa)} kPa for the curve alone "
            f"(weight {curve.weight:g}, {curve.rows} rows that count as {curve.rows / curve.correlation_rows:.1f})"
        )
        if curve.rmse_Pa > _CONTRADICTS * curve.rmse_alone_Pa:
            lines.append(
                f"doubt: {curve.path} and the edges contradict each other: is it the same material, and its unit right?"
            )
    for doubt in fit.doubts:
        where = fit.datasets[doubt.dataset].path + ("" if doubt.state is None else f", state {doubt.state}")
        lines.append(f"doubt: {where}: {doubt.words}")
    return lines


def comparison_table(fits: Sequence[FitRecord]) -> list[str]:
    """The laws against each other; nothing where they cannot be compared."""
    choices = comparison(fits)
    if not choices:
        return []
    lines = ["law              unknowns    AICc     BIC   weight   error on states left out"]
    for choice in choices:
        aicc = "too few" if choice.aicc is None else f"{choice.aicc:7.1f}"
        lines.append(
            f"{choice.model:16s} {choice.unknowns:8d} {aicc} {choice.bic:7.1f} {choice.weight:8.3f}   "
            f"{1e3 * choice.held_out_error_mm:.2f} µm"
        )
    return lines


def _kPa(pascal: float) -> str:
    return f"{1e-3 * pascal:.4g}"


def _scaled(value: float, unit: str) -> str:
    return f"{100 * value:.3g} %" if unit == "1" else f"{value:.3g} {unit}"


def _deviation(quantity: Quantity) -> str:
    low, high = (_scaled(end, quantity.unit) for end in quantity.interval_95)
    return f"{_scaled(quantity.value, quantity.unit)} [{low}, {high}]"
