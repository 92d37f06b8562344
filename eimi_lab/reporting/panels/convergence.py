"""Show how the search of each fit converges: the smallest error against the generation.

A generation is a round of trial values of the parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.ticker import MaxNLocator

from eimi_lab.fits.records import FitRecord
from eimi_lab.reporting.contents import ReportContents
from eimi_lab.reporting.elements import Picture, Table
from eimi_lab.reporting.panel import ReportPanel
from eimi_lab.reporting.shown import ShownFit
from eimi_lab.showing.drawing import WIDTH_IN, Drawing, label, plain_logarithm

_NARROW_IN = 4.8  # width of the figure with few fits, so narrow that its caption stands beside it
_ABREAST = 6  # most fits in a legend below the figure
_HEAD = (
    *("law", "generations", "evaluations", "not converged", "unstable", "polish", "final error"),
    *("stopped by", "seed", "time"),
)
_CAPTION = (
    "The CMA-ES search of each fit. Not converged and unstable: the numbers of discarded candidates. Polish: the mean "
    "error before and after the Gauss-Newton refinement, on the mesh and with the planar section of the search. Final "
    "error: the mean error with the corrections for a finer mesh and for the solid section."
)


def drawn_convergence(fits: Sequence[ShownFit]) -> Drawing:
    """Draw the smallest mean error of each search against the generation (round of trial values of the parameters)."""
    drawing = Drawing(2.6, WIDTH_IN if len(fits) > _ABREAST else _NARROW_IN)
    axes = drawing.subplots()
    for shown in fits:
        if isinstance(shown.fit, FitRecord):
            best = [1e3 * generation.best_mm for generation in shown.fit.history]
            style = {"color": shown.colour, "linestyle": shown.line, "marker": shown.marker, "markersize": 3}
            axes.semilogy(range(1, len(best) + 1), best, label=shown.label, **style)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    plain_logarithm(axes)
    label(axes, "generation", "smallest mean error, µm")
    many = len(fits) > _ABREAST
    drawing.legend(loc="outside right upper" if many else "outside lower center", ncols=1 if many else 2)
    return drawing


def table_of_searches(fits: Sequence[ShownFit]) -> Table:
    """Return a table with the number of trial values, the mean errors and the duration of each fit."""
    rows = [
        (
            shown.label,
            str(fit.generations),
            str(fit.evaluations),
            str(fit.discarded.unconverged),
            str(fit.discarded.unstable),
            f"{1e3 * fit.polish.mean_error_before_mm:.2f} to {1e3 * fit.polish.mean_error_after_mm:.2f} µm",
            f"{1e3 * fit.mean_error_mm:.2f} µm",
            fit.stop,
            str(fit.seed),
            f"{fit.wall_s:.1f} s",
        )
        for shown in fits
        if isinstance(fit := shown.fit, FitRecord)
    ]
    return Table("searches", _CAPTION, _HEAD, rows)


def _values(report: ReportContents) -> dict[str, Any] | None:
    if not report.bending:
        return None
    drawn = drawn_convergence(report.bending)
    caption = (
        "The smallest mean error that each search has reached up to each generation, on the mesh and with the planar "
        "section of the search. The corrections for a finer mesh and for the solid section are made after the search."
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
