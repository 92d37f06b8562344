"""Which files, which programs and which command this report is from."""

from __future__ import annotations

import hashlib
from typing import Any

from eimi_lab.fits.records import FitRecord, TensileRecord
from eimi_lab.reporting.contents import ReportContents
from eimi_lab.reporting.elements import Table
from eimi_lab.reporting.panel import ReportPanel


def sources(report: ReportContents) -> Table:
    """Every file by its content."""
    rows = [("dataset", str(shown.dataset.path), shown.evidence.sha256) for shown in report.datasets]
    shown = {row[2] for row in rows}
    rows += [
        ("fits", str(p), hashlib.sha256(p.read_bytes()).hexdigest())
        for p in dict.fromkeys(s.path for s in report.every)
    ]
    for found in report.every:
        fit = found.fit
        if isinstance(fit, TensileRecord):
            rows.append(("tensile test", fit.source.path, fit.source.sha256))
        if isinstance(fit, FitRecord):
            rows += [("dataset of a fit", d.path, d.sha256) for d in fit.datasets if d.sha256 not in shown]
            rows += [("tensile test", curve.name, curve.sha256) for curve in fit.tensile]
    return Table("files", "The files, by their content.", ("what", "file", "SHA-256"), list(dict.fromkeys(rows)))


def versions(report: ReportContents) -> list[str]:
    """The programs that made the fits, a line for each set of them."""
    every = [", ".join(f"{name} {number}" for name, number in s.fit.versions.items()) for s in report.every]
    return list(dict.fromkeys(every))


def _values(report: ReportContents) -> dict[str, Any]:
    return {"files": sources(report), "versions": versions(report), "command": report.command}


PANEL = ReportPanel(
    place=30,
    after_datasets=True,
    title="Provenance",
    template="""
{{ files | table }}
{% for line in versions %}<p>Fitted with {{ line }}.</p>{% endfor %}
{% if command %}<p>This report was written by</p><pre>{{ command }}</pre>{% endif %}
""",
    values=_values,
)
