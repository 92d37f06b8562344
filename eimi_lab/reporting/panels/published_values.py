"""Compare the identified modulus with published moduli of the same silicone."""

from __future__ import annotations

from typing import Any

from eimi_fitting.inference.evidence.quantity import Quantity
from eimi_lab.fits.records import FitRecord
from eimi_lab.reporting.contents import ReportContents
from eimi_lab.reporting.elements import Table
from eimi_lab.reporting.findings import Finding, findings
from eimi_lab.reporting.panel import ReportPanel
from eimi_lab.reporting.published_moduli import PublishedModulus, published_moduli
from eimi_lab.showing.rounded import format_quantity
from eimi_lab.showing.significant import significant

_HEAD = ("shear modulus", "ratio to this result", "how", "source")
_NOTE = (
    "The modulus of a silicone depends on lot, mixture and cure, and on the strain at which the modulus is determined. "
    "A factor of two between sources is common."
)


def table_of_published(finding: Finding, material: str) -> Table | None:
    """Return a table of published moduli, with their ratios to the identified modulus; None without any."""
    published = published_moduli(material)
    if not published:
        return None
    modulus = finding.shown.fit.initial_shear_modulus
    here = (format_quantity(modulus), "1", f"this result: {finding.how}; 95 % interval", "this report")
    rows = [here, *(_row(row, modulus) for row in published)]
    return Table("published", f"Published shear moduli of {material}, compared with this result.", _HEAD, rows, [_NOTE])


def _row(row: PublishedModulus, modulus: Quantity) -> tuple[str, str, str, str]:
    ends = dict.fromkeys((row.low_Pa, row.high_Pa))
    kPa = " to ".join(significant(1e-3 * end, 3) for end in ends)
    ratio = " to ".join(significant(end / modulus.value, 2) for end in ends)
    return f"{kPa} kPa", ratio, row.how.replace("`", ""), row.source


def _values(report: ReportContents) -> dict[str, Any] | None:
    tables = dict[str, Table]()
    for finding in findings(report):
        for material in _materials(finding, report):
            table = table_of_published(finding, material)
            if table is not None:
                tables.setdefault(material, table)
    return {"tables": list(tables.values())} if tables else None


def _materials(finding: Finding, report: ReportContents) -> list[str]:
    fit = finding.shown.fit
    if not isinstance(fit, FitRecord):
        return [fit.source.material] if fit.source.material else []
    hashes = {reference.sha256 for reference in fit.datasets}
    beams = [c.dataset.specimen.specimen for c in report.datasets if c.evidence.sha256 in hashes]
    return list(dict.fromkeys(beam.material for beam in beams))


PANEL = ReportPanel(
    place=6,
    summary=True,
    title="Published values",
    template="{% for published in tables %}{{ published | table }}{% endfor %}",
    values=_values,
)
