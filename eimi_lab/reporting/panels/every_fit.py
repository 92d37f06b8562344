"""Show the mean error of each fit on each specimen."""

from __future__ import annotations

from typing import Any

from eimi_lab.fits.validation import Validation
from eimi_lab.fits.validation_tables import error_in_words
from eimi_lab.reporting.contents import ReportContents
from eimi_lab.reporting.elements import Cell, Table
from eimi_lab.reporting.panel import ReportPanel
from eimi_lab.reporting.shown import ShownFit

_ABREAST = 4  # columns of specimens in one table


def matrix(report: ReportContents) -> list[tuple[ShownFit, list[tuple[Validation, bool]]]]:
    """Return each fit with its errors on all datasets of a report.

    For each dataset, there is a pair: the errors of the fit, and whether their mean is the smallest of all fits.
    """
    columns = [shown.validations for shown in report.datasets]
    least = [min((v.mean_error_mm for v in column if v.mean_error_mm is not None), default=None) for column in columns]
    return [
        (fit, [(v[i], best is not None and v[i].mean_error_mm == best) for v, best in zip(columns, least, strict=True)])
        for i, fit in enumerate(report.fits)
    ]


def tables(report: ReportContents) -> list[Table]:
    """Return tables of the errors of all fits on all specimens."""
    names = [shown.name for shown in report.datasets]
    caption = "Each fit on each specimen: mean error over the states in µm, with its 95 % interval."
    parts = []
    for first in range(0, len(names), _ABREAST):
        part = slice(first, first + _ABREAST)
        rows = [(s.fit.model, s.origin, *(_cell(v, best) for v, best in row[part])) for s, row in matrix(report)]
        parts.append(Table("every_fit", caption, ("law", "fitted to", *names[part]), rows))
    return parts


def _cell(validation: Validation, best: bool) -> str | Cell:
    text = error_in_words(validation) + ("*" if validation.seen else "")
    return Cell(text, "best") if best else text


def _values(report: ReportContents) -> dict[str, Any] | None:
    if not report.fits or (len(report.datasets) == 1 and not report.tensile):
        return None
    return {"tables": tables(report)}


PANEL = ReportPanel(
    place=30,
    title="Each fit on each specimen",
    template="""
{% for matrix in tables %}{{ matrix | table }}{% endfor %}
<p class="note">The interval contains 95 % of the mean errors that the draws of the fit give on this specimen, including
the uncertainty of the specimen. &gt;: the interval has no upper end, because the beam has no equilibrium for one of the
draws. *: the law was fitted to this specimen; all other errors are errors of predictions. Bold: the smallest error of
the column.</p>
""",
    values=_values,
    of_intervals=True,
)
