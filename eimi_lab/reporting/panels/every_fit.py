"""Every fit on every specimen."""

from __future__ import annotations

from typing import Any

from eimi_lab.fits.validation import Validation
from eimi_lab.fits.validation_tables import error_in_words
from eimi_lab.reporting.contents import ReportContents
from eimi_lab.reporting.elements import Cell, Table
from eimi_lab.reporting.panel import ReportPanel
from eimi_lab.reporting.shown import ShownFit

_ABREAST = 4  # specimens in one table


def matrix(report: ReportContents) -> list[tuple[ShownFit, list[tuple[Validation, bool]]]]:
    """Each fit with its validation on every dataset, and whether that is the dataset's smallest error."""
    validations = [shown.validations for shown in report.datasets]
    least = [min((v.mean_error_mm for v in own if v.mean_error_mm is not None), default=None) for own in validations]
    return [
        (fit, [(own[i], own[i].mean_error_mm == best) for own, best in zip(validations, least, strict=True)])
        for i, fit in enumerate(report.every)
    ]


def tables(report: ReportContents) -> list[Table]:
    """The matrix, so many specimens abreast as a page holds."""
    names = [shown.name for shown in report.datasets]
    found = []
    for first in range(0, len(names), _ABREAST):
        own = slice(first, first + _ABREAST)
        rows = [(s.fit.model, s.origin, *(_cell(v, best) for v, best in row[own])) for s, row in matrix(report)]
        caption = "Every fit on every specimen: mean error over the states in µm, with its 95 % interval."
        found.append(Table("every_fit", caption, ("law", "fitted to", *names[own]), rows))
    return found


def _cell(validation: Validation, best: bool) -> str | Cell:
    text = error_in_words(validation) + ("*" if validation.seen else "")
    return Cell(text, "best") if best else text


def _values(report: ReportContents) -> dict[str, Any] | None:
    if not report.every or (len(report.datasets) == 1 and not report.tensile):
        return None
    return {"tables": tables(report)}


PANEL = ReportPanel(
    place=30,
    title="Every fit on every specimen",
    template="""
{% for matrix in tables %}{{ matrix | table }}{% endfor %}
<p class="note">The interval holds 95 % of the mean errors that the fit's draws have here, with what is uncertain
about the specimen; &gt; where one of the draws finds no equilibrium. * fitted to this specimen; all others are
predictions. Bold: the smallest.</p>
""",
    values=_values,
    of_intervals=True,
)
