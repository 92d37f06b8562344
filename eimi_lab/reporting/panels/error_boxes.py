"""Compare the errors of all fits on each specimen by box plots.

The error of a load step is the root mean square distance between measured and simulated points.
"""

from __future__ import annotations

from textwrap import shorten
from typing import Any

import numpy as np

from eimi_lab.reporting.contents import ReportContents
from eimi_lab.reporting.elements import Picture
from eimi_lab.reporting.panel import ReportPanel
from eimi_lab.reporting.panels.error_against_field import legend_of_fits
from eimi_lab.reporting.shown import ShownFit
from eimi_lab.showing.drawing import WIDTH_IN, Drawing, label, plain_logarithm

_NARROW_IN = 4.8  # width of the figure of one dataset, so narrow that its caption stands beside it
_LOG_FROM = 20  # ratio of the largest to the smallest median from which the axis is logarithmic


def drawn_boxes(report: ReportContents) -> Drawing:
    """Draw a box plot of the errors at the load steps for each fit and specimen.

    The error is the root mean square distance of measured points from simulated edges.
    """
    columns = min(3, len(report.datasets))
    rows = -(-len(report.datasets) // columns)
    drawing = Drawing(2.0 * rows + 0.5, WIDTH_IN if columns > 1 else _NARROW_IN)
    grid = drawing.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    medians, drawn = [], {}
    for axes, contents in zip(grid, report.datasets, strict=False):
        for place, s in enumerate(report.fits):
            prediction = contents.simulated_by(s)
            if prediction is None:
                continue
            drawn[s.label] = s
            medians.append(float(np.median(prediction.error_mm)))
            edge = {"color": s.colour}
            axes.boxplot(
                [1e3 * prediction.error_mm],
                positions=[place],
                widths=0.6,
                whis=(0, 100),
                patch_artist=True,
                manage_ticks=False,
                boxprops={"facecolor": s.colour, "alpha": 0.45},
                medianprops={"color": "black"},
                whiskerprops={**edge, "linestyle": s.line},
                capprops=edge,
            )
        axes.set_title(shorten(f"{contents.name}: {contents.dataset.specimen.specimen.name}", 38), loc="left")
        axes.set_xticks([])
        axes.grid(axis="x", visible=False)
        axes.set_xlim(-0.7, len(report.fits) - 0.3)
    for unused in grid[len(report.datasets) :]:
        unused.axis("off")
    if max(medians) > _LOG_FROM * max(min(medians), 1e-9):
        grid[0].set_yscale("log")
        plain_logarithm(grid[0])
    else:
        grid[0].set_ylim(bottom=0)
    for axes in grid[::columns]:
        label(axes, "", "error of a state, µm")
    legend_of_fits(drawing, list[ShownFit](drawn.values()))
    return drawing


def _values(report: ReportContents) -> dict[str, Any] | None:
    shown = sum(len(contents.simulated) for contents in report.datasets)
    if shown < 2:
        return None
    caption = (
        "Errors of the states, by specimen and fit: median, quartiles and extremes. The fits are in the order of the "
        "table of laws. The line style of the whiskers shows the data to which the law was fitted. The fits were "
        "simulated again for this figure. With a solid section these errors may differ by up to half a µm from the "
        "errors of the fits, because a fit interpolates the effect of the depth between states."
    )
    return {"picture": Picture("error_boxes", drawn_boxes(report), "box plots of the errors", caption)}


PANEL = ReportPanel(place=29, title="Errors by law and specimen", template="{{ picture | figure }}", values=_values)
