"""List the files, the program versions and the command from which the report was made."""

from __future__ import annotations

import hashlib
from typing import Any

from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.tensile_record import TensileRecord
from eimi_lab.reporting.contents import ReportContents
from eimi_lab.reporting.elements import Table
from eimi_lab.reporting.panel import ReportPanel


def sources(report: ReportContents) -> Table:
    """Return a table of all files with the hashes of their contents."""
    rows = [("dataset", str(shown.dataset.path), shown.evidence.sha256) for shown in report.datasets]
    hashes = {sha256 for _, _, sha256 in rows}
    paths = dict.fromkeys(shown.path for shown in report.fits)
    rows += [("fits", str(path), hashlib.sha256(path.read_bytes()).hexdigest()) for path in paths]
    for shown in report.fits:
        fit = shown.fit
        if isinstance(fit, TensileRecord):
            rows.append(("tensile test", fit.source.path, fit.source.sha256))
        if isinstance(fit, FitRecord):
            rows += [("dataset of a fit", d.path, d.sha256) for d in fit.datasets if d.sha256 not in hashes]
            rows += [("tensile test", curve.name, curve.sha256) for curve in fit.tensile]
    caption = "The files and the SHA-256 hashes of their contents."
    return Table("files", caption, ("what", "file", "SHA-256"), list(dict.fromkeys(rows)))


def versions(report: ReportContents) -> list[str]:
    """Return the versions of the programs that computed the fits, a line for each different set of versions."""
    lines = [", ".join(f"{name} {number}" for name, number in s.fit.versions.items()) for s in report.fits]
    return list(dict.fromkeys(lines))


def _values(report: ReportContents) -> dict[str, Any]:
    return {"files": sources(report), "versions": versions(report), "command": report.command}


PANEL = ReportPanel(
    place=30,
    after_datasets=True,
    title="Provenance",
    template="""
{{ files | table }}
{% for line in versions %}<p>Fitted with {{ line }}.</p>{% endfor %}
{% if command %}<p>This command wrote the report:</p><pre>{{ command }}</pre>{% endif %}
""",
    values=_values,
)
