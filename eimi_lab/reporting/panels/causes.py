"""Show the possible causes of the residuals of the best fits, such as a tilted camera, with their probabilities."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from eimi_fitting.inference.doubts.causes import NONE
from eimi_lab.fits.fit_summary import signed
from eimi_lab.fits.records import FitRecord
from eimi_lab.reporting.contents import ReportContents
from eimi_lab.reporting.elements import Table
from eimi_lab.reporting.findings import findings
from eimi_lab.reporting.panel import ReportPanel
from eimi_lab.reporting.shown import ShownFit
from eimi_lab.showing.significant import significant

_HEAD = ("law", "cause", "probability", "value", "change of the modulus", "measurement that decides")
_CAPTION = (
    "Possible causes of the residuals, compared by their evidence. Value: the most probable size of the cause. Change "
    "of the modulus: the result of a fit that takes the cause into account, relative to the result without the cause."
)
_NOTE = "Two causes may be present at the same time. The sum of the probabilities may therefore exceed 1."
_WITHIN = ", within the stated uncertainty"
_LEAST = 0.01  # a cause of smaller probability has no row, except the first two


def table_of_causes(fits: Sequence[ShownFit]) -> Table | None:
    """Return a table of probable causes of the residuals, such as a tilted camera; None if no causes were compared."""
    rows = [
        (
            shown.label,
            "no listed cause" if cause.name == NONE else cause.name.replace("_", " "),
            f"{cause.probability:.2f}",
            "" if cause.name == NONE else signed(cause.value, cause.unit) + _WITHIN * cause.is_within_stated,
            "" if cause.name == NONE else f"{significant(cause.shift_percent, 2, '+')} %",
            cause.decide_by,
        )
        for shown in fits
        if isinstance(shown.fit, FitRecord)
        for i, cause in enumerate(shown.fit.causes)
        if i < 2 or cause.probability >= _LEAST
    ]
    return Table("causes", _CAPTION, _HEAD, rows, [_NOTE]) if rows else None


def _values(report: ReportContents) -> dict[str, Any] | None:
    table = table_of_causes([finding.shown for finding in findings(report)])
    return {"table": table} if table else None


PANEL = ReportPanel(
    place=4, summary=True, title="Causes of the residuals", template="{{ table | table }}", values=_values
)
