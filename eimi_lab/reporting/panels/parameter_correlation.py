"""Show the correlations between the errors of the fitted parameters and inputs of each fit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from eimi_lab.fits.records import FitRecord
from eimi_lab.reporting.contents import ReportContents
from eimi_lab.reporting.elements import Picture
from eimi_lab.reporting.panel import ReportPanel
from eimi_lab.reporting.shown import ShownFit
from eimi_lab.showing.drawing import WIDTH_IN, Drawing
from eimi_lab.showing.palette import OF_TWO_SIGNS

_MOST = 6  # matrices
_ABREAST = 3
_NAMES = 4.5  # width of the names beside a matrix, in cells
_CELL_IN = 0.36
_NARROWEST = 4  # cells, which the title above a matrix needs


def drawn_correlations(fits: Sequence[tuple[ShownFit, FitRecord]]) -> Drawing:
    """Draw the correlation matrix of the fitted parameters and inputs of each fit."""
    sizes = [len(fit.identifiability.names) for _, fit in fits]
    columns = min(_ABREAST, len(fits))
    rows = -(-len(fits) // columns)
    # every column is as wide as its largest matrix and the names beside it, in cells
    cells = [max(_NARROWEST, *sizes[column::columns]) for column in range(columns)]
    widths = [_NAMES + count for count in cells]
    cell_in = min(_CELL_IN, WIDTH_IN / sum(widths))
    tallest = [max(sizes[row * columns : (row + 1) * columns]) for row in range(rows)]
    drawing = Drawing(cell_in * sum(tallest) + 0.75 * rows, cell_in * sum(widths))
    grid = drawing.subplots(rows, columns, squeeze=False, width_ratios=cells, height_ratios=tallest).ravel()
    for place, (axes, (shown, fit)) in enumerate(zip(grid, fits, strict=False)):
        names = [name.replace("_", " ") for name in fit.identifiability.names]
        matrix = np.round(fit.identifiability.correlation, 2)
        axes.imshow(matrix, cmap=OF_TWO_SIGNS, vmin=-1, vmax=1)
        for (i, j), value in np.ndenumerate(matrix):
            axes.text(
                j,
                i,
                f"{value + 0.0:.2f}",
                ha="center",
                va="center",
                fontsize=5.5,
                color="white" if abs(value) > 0.7 else "black",
            )
        axes.set_xticks(range(len(names)), [str(i + 1) for i in range(len(names))])
        axes.set_yticks(range(len(names)), [f"{name}  {i + 1}" for i, name in enumerate(names)])
        axes.set_xlim(-0.5, cells[place % columns] - 0.5)  # cells of one size in every matrix
        axes.set_ylim(tallest[place // columns] - 0.5, -0.5)
        axes.set_anchor("NW")
        axes.xaxis.tick_top()
        axes.set_title(shown.label, loc="left", pad=18)  # above the numbers
        axes.grid(visible=False)
        axes.spines[:].set_visible(False)
        axes.tick_params(length=0)
    for unused in grid[len(fits) :]:
        unused.axis("off")
    return drawing


def _values(report: ReportContents) -> dict[str, Any] | None:
    fits = [(s, s.fit) for s in report.bending if isinstance(s.fit, FitRecord) and len(s.fit.identifiability.names) > 1]
    if not fits:
        return None
    caption = (
        "Correlation of the errors of all unknowns of a fit. Where a correlation is near ±1, the data determine a "
        "combination of the two unknowns, but not the value of each unknown."
    )
    if len(fits) > _MOST:
        caption += f" Shown are the first {_MOST} of {len(fits)} fits."
    drawn = drawn_correlations(fits[:_MOST])
    return {"picture": Picture("correlation", drawn, "correlation of the unknowns", caption)}


PANEL = ReportPanel(
    place=17, title="Correlation of the unknowns", template="{{ picture | figure }}", values=_values, of_fits=True
)
