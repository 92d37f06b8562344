"""How each search went."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.ticker import MaxNLocator

from eimi_lab.fits.records import FitRecord
from eimi_lab.reporting.contents import ReportContents
from eimi_lab.reporting.elements import Picture, Table
from eimi_lab.reporting.panel import ReportPanel
from eimi_lab.reporting.shown import ShownFit
from eimi_lab.showing.drawing import Drawing, label, plain_logarithm

_HEAD = ("law", "generations", "evaluations", "discarded", "polish", "in the end", "stopped by", "seed", "time")
_CAPTION = (
    "Each search by CMA-ES; the mean error before and after the polish by Gauss-Newton, under the search's planar "
    "assumption; and in the end, with what a finer mesh and the solid change."
)


def drawn_convergence(every: Sequence[ShownFit]) -> Drawing:
    """Best error of each generation of each search."""
    drawing = Drawing(3.2)
    axes = drawing.subplots()
    for shown in every:
        if isinstance(shown.fit, FitRecord):
            best = [1e3 * generation.best_mm for generation in shown.fit.history]
            style = {"color": shown.colour, "linestyle": shown.line, "marker": shown.marker, "markersize": 3}
            axes.semilogy(range(1, len(best) + 1), best, label=shown.label, **style)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    plain_logarithm(axes)
    label(axes, "generation", "best mean error, µm")
    drawing.legend(
        loc="outside right upper" if len(every) > 6 else "outside lower center", ncols=1 if len(every) > 6 else 3
    )
    return drawing


def table_of_searches(every: Sequence[ShownFit]) -> Table:
    """A row a search."""
    rows = [
        (
            shown.label,
            str(fit.generations),
            str(fit.evaluations),
            f"{fit.discarded.unconverged} not converged, {fit.discarded.unstable} unstable",
            f"{1e3 * fit.polish.mean_error_before_mm:.2f} to {1e3 * fit.polish.mean_error_after_mm:.2f} µm",
            f"{1e3 * fit.mean_error_mm:.2f} µm",
            fit.stop,
            str(fit.seed),
            f"{fit.wall_s:.1f} s",
        )
        for shown in every
        if isinstance(fit := shown.fit, FitRecord)
    ]
    return Table("searches", _CAPTION, _HEAD, rows)


def _values(report: ReportContents) -> dict[str, Any] | None:
    if not report.bending:
        return None
    drawn = drawn_convergence(report.bending)
    caption = (
        "The best mean error so far of each search, on its own mesh and under its planar assumption; what a finer mesh "
        "and the solid change is added after it."
    )
    return {
        "picture": Picture("convergence", drawn, "best error by generation", caption),
        "searches": table_of_searches(report.bending),
    }


PANEL = ReportPanel(
    place=10,
    after_datasets=True,
    title="Search",
    template="""
{{ picture | figure }}
{{ searches | table }}
""",
    values=_values,
    of_fits=True,
)
