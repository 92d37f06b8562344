"""Errors of the states of every specimen, by law: how each fit does where it was fitted and where it was not."""

from __future__ import annotations

from textwrap import shorten
from typing import Any

import numpy as np

from eimi_lab.reporting.contents import ReportContents
from eimi_lab.reporting.elements import Picture
from eimi_lab.reporting.panel import ReportPanel
from eimi_lab.reporting.panels.error_against_field import legend_of_fits
from eimi_lab.reporting.shown import ShownFit
from eimi_lab.showing.drawing import Drawing, label, plain_logarithm

_LOG_FROM = 20  # largest over smallest median beyond which the errors are drawn on a logarithmic axis


def drawn_boxes(report: ReportContents) -> Drawing:
    """Axes for each specimen, all to one scale; a box for each fit in their order, in the colour of its law."""
    columns = min(3, len(report.datasets))
    rows = -(-len(report.datasets) // columns)
    drawing = Drawing(2.3 * rows + 0.6)
    grid = drawing.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    medians, drawn = [], {}
    for axes, contents in zip(grid, report.datasets, strict=False):
        for place, s in enumerate(report.every):
            own = contents.simulated_by(s)
            if own is None:
                continue
            drawn[s.label] = s
            medians.append(float(np.median(own.error_mm)))
            edge = {"color": s.colour}
            axes.boxplot(
                [1e3 * own.error_mm],
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
        axes.set_xlim(-0.7, len(report.every) - 0.3)
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
        "Errors of the states, by specimen and fit: median, quartiles and extremes. Fits stand in the order of the "
        "table of laws; whiskers have the line of what the law was fitted to. The fits are simulated anew: of a "
        "solid within half a µm of the errors that the fits had themselves, which told the depth's effect from state "
        "to state."
    )
    return {"picture": Picture("error_boxes", drawn_boxes(report), "box plots of the errors", caption)}


PANEL = ReportPanel(place=29, title="Errors by law and specimen", template="{{ picture | figure }}", values=_values)
