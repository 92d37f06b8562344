"""Show the possible causes of the residuals, such as a tilted camera, for all fits that are not on the first pages."""

from __future__ import annotations

from typing import Any

from eimi_lab.reporting.contents import ReportContents
from eimi_lab.reporting.findings import findings
from eimi_lab.reporting.panel import ReportPanel
from eimi_lab.reporting.panels.causes import table_of_causes


def _values(report: ReportContents) -> dict[str, Any] | None:
    chosen = [finding.shown for finding in findings(report)]
    table = table_of_causes([shown for shown in report.bending if shown not in chosen])
    return {"table": table} if table else None


PANEL = ReportPanel(
    place=16, title="Causes of the residuals of other fits", template="{{ table | table }}", values=_values
)
