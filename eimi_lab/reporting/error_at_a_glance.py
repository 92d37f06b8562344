"""Draw the error of a fit against the magnetic field, for every dataset of a report.

The error of a load step is the root mean square distance between measured and simulated points.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.ticker import MaxNLocator

from eimi_lab.fits.simulated_fit import Prediction
from eimi_lab.reporting.contents import DatasetContents, ReportContents
from eimi_lab.reporting.elements import Picture
from eimi_lab.reporting.shown import ShownFit
from eimi_lab.showing.drawing import Drawing, label
from eimi_lab.showing.palette import LINES, MARKERS, PALETTE

WIDTH_IN = 4.4  # width of the figures of the first page
_MOST = len(MARKERS)  # largest number of datasets in the figure


def drawn_at_a_glance(leading: Sequence[tuple[DatasetContents, Prediction[ShownFit]]]) -> Drawing:
    """Draw the error at each load step against the magnetic field, with a line for each dataset.

    `leading` contains pairs of a dataset and its simulation. The error is the root mean square distance between
    measured points and simulated edges.
    """
    drawing = Drawing(2.3, WIDTH_IN)
    axes = drawing.subplots()
    fields = [state.field_mT for _, prediction in leading for state in prediction.evidence.states]
    constant = not fields or max(fields) == min(fields)
    for place, (contents, prediction) in enumerate(leading):
        states = prediction.evidence.states
        x = np.array([float(s.index) if constant else s.field_mT for s in states])
        order = x.argsort(kind="stable")
        error, deviation = 1e3 * prediction.error_mm[order], 1e3 * prediction.deviation_mm[order]
        colour = PALETTE[place % len(PALETTE)]
        axes.fill_between(x[order], (error - deviation).clip(min=0), error + deviation, color=colour, alpha=0.15, lw=0)
        style = {"marker": MARKERS[place % len(MARKERS)], "linestyle": LINES[place % len(LINES)]}
        axes.plot(x[order], error, color=colour, label=f"{contents.name}, {prediction.fitted_law.label}", **style)
    if constant:
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_ylim(bottom=0)
    label(axes, "state" if constant else "field, mT", "error, µm")
    if len(leading) > 1:
        drawing.legend(loc="outside lower center", ncols=1)
    return drawing


def error_at_a_glance(report: ReportContents) -> Picture | None:
    """Return the figure of the errors against the magnetic field; None if no fit was simulated."""
    leading = [(contents, contents.best) for contents in report.datasets if contents.best is not None][:_MOST]
    if not leading:
        return None
    laws = list(dict.fromkeys(prediction.fitted_law.label for _, prediction in leading))
    caption = (
        f"Error of {', '.join(laws)} in each state: the root mean square of the distances between simulated and "
        "measured beam. Band: the error ± one standard deviation of the distances."
    )
    scales = {round(c.dataset.calibration.pixels_per_mm, 6) for c, _ in leading if c.dataset.calibration is not None}
    if len(scales) == 1:
        caption += f" One pixel is {1e3 / scales.pop():.4g} µm."
    if len(report.datasets) > len(leading):
        caption += f" Shown are {len(leading)} of {len(report.datasets)} datasets."
    return Picture("error_at_a_glance", drawn_at_a_glance(leading), "error by field", caption, of_half_width=True)
