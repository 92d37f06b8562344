"""Show parameters, misfit and largest stretch of each fit, and the comparison of the laws."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from eimi_fitting.inference.planning.choice_of_law import Choice
from eimi_lab.fits.fit_summary import points_in_words, too_few_in_words, what_is_fixed, what_was_fitted_beside
from eimi_lab.fits.law_record import LawRecord
from eimi_lab.fits.measured_remarks import measured_lines
from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.tensile_record import TensileRecord
from eimi_lab.fits.validation_tables import micrometres
from eimi_lab.reporting.contents import ReportContents
from eimi_lab.reporting.elements import Cell, Table
from eimi_lab.reporting.panel import ReportPanel
from eimi_lab.reporting.shown import ShownFit
from eimi_lab.showing.rounded import format_quantity
from eimi_lab.showing.significant import significant

_HEAD = (
    "law",
    "fitted to",
    "initial shear modulus [95 %]",
    "parameters [95 %]",
    "error ± deviation",
    "stretch reached",
)
_NOTE = (
    "Stretch reached: the largest stretch in the data. Beyond this stretch a law is an extrapolation. Not measured: "
    "the bounds of the search determine the value and its interval, or the interval from a tensile curve contains zero."
)
_INTERVALS = (
    "Intervals of bending fits include the scatter of the measured edges or points, the error of the mesh, and all "
    "uncertainties in the files of specimen, calibration and rig. The model of the cross-section and all numbers "
    "without an uncertainty are taken as exact."
)


def table_of_laws(fits: Sequence[ShownFit], bending: bool) -> Table:
    """Return a table of parameters, misfit and largest stretch in the data, with a row for each fit.

    `bending` tells whether the fits have bent beams.
    """
    rows = [
        (s.fit.model, s.origin, _modulus(s.fit), _parameters(s.fit), _misfit(s.fit), f"{s.fit.stretch_reached:.3f}")
        for s in fits
    ]
    notes = [_NOTE, _INTERVALS] if bending else [_NOTE]
    origins = {shown.origin for shown in fits}
    if len(origins) > 1:
        return Table("laws", "The result of each fit.", _HEAD, rows, notes)
    without_origin = [(law, *result) for law, _, *result in rows]
    caption = f"The result of each fit. Fitted to: {origins.pop()}."
    return Table("laws", caption, (_HEAD[0], *_HEAD[2:]), without_origin, notes)


def table_of_choice(choices: Sequence[Choice]) -> Table:
    """Return a table that compares laws by information criteria and by the error on load steps left out of the fit."""
    head = ("law", "unknowns", "AICc", "BIC", "Akaike weight", "error on states left out, µm")
    rows = [
        (
            c.model,
            str(c.unknowns),
            "too few data" if c.aicc is None else f"{c.aicc:.1f}",
            f"{c.bic:.1f}",
            "-" if c.weight is None else f"{c.weight:.3f}",
            micrometres(c.held_out_error_mm),
        )
        for c in choices
    ]
    caption = (
        "Comparison of the laws. AICc and BIC are differences from the best law. A smaller difference means that the "
        "data support the law, with its number of parameters, better."
    )
    return Table("comparison", caption, head, rows, [points_in_words(choices), *too_few_in_words(choices)])


def _modulus(fit: FitRecord | TensileRecord) -> str | Cell:
    return _marked(format_quantity(fit.initial_shear_modulus), "initial_shear_modulus" in fit.held_by_bounds())


def _parameters(fit: LawRecord) -> tuple[str | Cell, ...]:
    held = fit.held_by_bounds()
    return tuple(_marked(f"{name} = {format_quantity(q)}", name in held) for name, q in fit.parameters.items())


def _misfit(fit: FitRecord | TensileRecord) -> str:
    if isinstance(fit, TensileRecord):
        return f"RMSE {significant(1e-3 * fit.rmse_Pa, 3)} kPa"
    return f"{micrometres(fit.mean_error_mm)} ± {micrometres(fit.mean_deviation_mm)} µm"


def _marked(text: str, held: bool) -> str | Cell:
    return Cell(text, "held") if held else text


def _remarks(report: ReportContents) -> list[tuple[str, list[str]]]:
    """Return, for each fit with remarks, its label and its remarks as lines of text."""
    remarks_of_fits = []
    for shown in report.fits:
        fit = shown.fit
        if isinstance(fit, TensileRecord):
            lines = fit.not_fixed_in_words()
        else:
            states = [d.in_words() for d in fit.datasets if d.states.left_out or d.states.flagged]
            at_bound = fit.identifiability.at_bound
            bound = [f"On a bound of the search: {', '.join(at_bound)}."] if at_bound else []
            # the budget and the doubts have their own places in the report
            lines = [*states, *measured_lines(fit.datasets), *what_is_fixed(fit), *what_was_fitted_beside(fit), *bound]
        if lines:
            remarks_of_fits.append((shown.label, lines))
    return remarks_of_fits


def _doubts(fits: Sequence[ShownFit]) -> list[tuple[str, str]]:
    """Return the reasons to distrust a fit; each reason has the labels of the fits that it concerns."""
    labels_of: dict[str, list[str]] = {}
    for shown in fits:
        for words in shown.fit.doubts_in_words():
            labels_of.setdefault(words, []).append(shown.label)
    total = len(fits)
    return [
        (words, "all fits" if len(labels) == total > 1 else "; ".join(labels)) for words, labels in labels_of.items()
    ]


def _values(report: ReportContents) -> dict[str, Any] | None:
    if not report.fits:
        return None
    comparisons = dict.fromkeys(shown.comparison for shown in report.bending if shown.comparison)
    return {
        "laws": table_of_laws(report.fits, bool(report.bending)),
        "remarks": _remarks(report),
        "doubts": _doubts(report.fits),
        "comparisons": [table_of_choice(choices) for choices in comparisons],
    }


PANEL = ReportPanel(
    place=10,
    title="Laws",
    template="""
{{ laws | table }}
<ul>
{% for label, lines in remarks %}
<li><b>{{ label }}</b>: {% for words in lines %}{{ words }}{% if not loop.last %}<br>{% endif %}{% endfor %}</li>
{% endfor %}
{% for words, labels in doubts %}<li><b>Doubt</b> about {{ labels }}: {{ words }}</li>
{% endfor %}
</ul>
{% for choices in comparisons %}{{ choices | table }}{% endfor %}
""",
    values=_values,
    of_fits=True,
)
