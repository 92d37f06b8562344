"""Compare the stretch up to which each law is stable (by Drucker's criterion) with the largest stretch in its data."""

from __future__ import annotations

from typing import Any

from eimi_lab.fits.records import FitRecord
from eimi_lab.fits.tensile_record import TensileRecord
from eimi_lab.reporting.contents import ReportContents
from eimi_lab.reporting.elements import Table
from eimi_lab.reporting.panel import ReportPanel

_HEAD = ("law", "stretch reached", "stable up to", "stable over the data")


def _row(label: str, fit: FitRecord | TensileRecord) -> tuple[str, ...]:
    limit, checked = fit.stability.stable_up_to_stretch, fit.stability.checked_up_to_stretch
    stable_to = f"≥ {checked:g}" if limit is None else "nowhere" if limit <= 1 else f"{limit:.2f}"
    reached = fit.stretch_reached
    over_data = "yes" if reached <= checked else f"checked up to {checked:g} only"
    if limit is not None and limit < reached:
        over_data = "no"
    return label, f"{reached:.3f}", stable_to, over_data


def _values(report: ReportContents) -> dict[str, Any] | None:
    if not report.fits:
        return None
    note = (
        "Stability by Drucker's criterion. ≥: stable at all stretches that were checked. Beyond the "
        "limit a finite-element simulation may fail."
    )
    rows = [_row(shown.label, shown.fit) for shown in report.fits]
    return {"stability": Table("stability", "The stretch up to which each law is stable.", _HEAD, rows, [note])}


PANEL = ReportPanel(
    place=20, after_datasets=True, title="Stability", template="{{ stability | table }}", values=_values, of_fits=True
)
