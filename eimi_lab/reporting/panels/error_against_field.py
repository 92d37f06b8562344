"""Show the error of each fit at each load step of a dataset.

The error is the root mean square distance between measured and simulated points.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from eimi_lab.fits.simulated_fit import Prediction
from eimi_lab.reporting.contents import DatasetContents
from eimi_lab.reporting.elements import Picture
from eimi_lab.reporting.panel import DatasetPanel
from eimi_lab.reporting.shown import ShownFit
from eimi_lab.showing.drawing import WIDTH_IN, Drawing, by_field, label, plain_logarithm

Array = NDArray[np.float64]

_NARROW_IN = 4.8  # width of the figure of one fit, so narrow that its caption stands beside it
_LOG_FROM = 20  # ratio of the largest to the smallest mean error from which the axis is logarithmic
_SPREAD = 0.5  # width over which the fits of one state are spread, as a fraction of the smallest gap between states


def drawn_errors(predictions: Sequence[Prediction[ShownFit]]) -> Drawing:
    """Draw the error of all fits at the load steps of a dataset against the magnetic field.

    The error is the root mean square distance between measured and simulated points.
    """
    states = predictions[0].evidence.states
    x, words = by_field([state.field_mT for state in states], [state.index for state in states])
    gaps = np.diff(np.unique(x))
    spread = _SPREAD * float(gaps.min()) if len(gaps) else 1.0
    means = [float(s.error_mm.mean()) for s in predictions]
    logarithmic = max(means) > _LOG_FROM * max(min(means), 1e-9)
    several = len(predictions) > 1
    drawing = Drawing(3.0, WIDTH_IN) if several else Drawing(2.1, _NARROW_IN)
    axes: Axes
    axes, *below_axes = np.atleast_1d(
        drawing.subplots(1 + several, 1, sharex=True, height_ratios=[3, 2] if several else [1])
    )
    for place, s in enumerate(predictions):
        error, deviation = 1e3 * s.error_mm, 1e3 * s.deviation_mm
        # On a logarithmic axis a bar that ends at zero would be infinitely long.
        below = error - np.maximum(error - deviation, 0.1 * error if logarithmic else 0.0)
        axes.errorbar(
            x + spread * (place / max(len(predictions) - 1, 1) - 0.5) * (len(predictions) > 1),
            error,
            yerr=[below, deviation],
            color=s.fitted_law.colour,
            marker=s.fitted_law.marker,
            linestyle=s.fitted_law.line,
            linewidth=1.1,
            elinewidth=0.8,
            capsize=1.5,
        )
    for differences in below_axes:
        _draw_differences(differences, predictions, x)
    if words == "state":
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    if logarithmic:
        axes.set_yscale("log")
        plain_logarithm(axes)
    else:
        axes.set_ylim(bottom=0)
    label(axes, "" if several else words, "error, µm")
    for differences in below_axes:
        label(differences, words, f"error minus the error\nof {predictions[0].fitted_law.fit.model}, µm")
    legend_of_fits(drawing, [s.fitted_law for s in predictions])
    return drawing


def _draw_differences(axes: Axes, predictions: Sequence[Prediction[ShownFit]], x: Array) -> None:
    """Draw the error of each fit minus the error of the first fit, in µm, at the places `x` on the axis."""
    axes.axhline(0, color=predictions[0].fitted_law.colour, linewidth=1.1)
    for s in predictions[1:]:
        law = s.fitted_law
        style = {"color": law.colour, "marker": law.marker, "linestyle": law.line, "linewidth": 1.1}
        axes.plot(x, 1e3 * (s.error_mm - predictions[0].error_mm), **style)


def legend_of_fits(drawing: Drawing, fits: Sequence[ShownFit]) -> None:
    """Add a legend of the laws and, if the laws were fitted to several kinds of data, of the kinds of data."""
    handles = {
        s.fit.model: Line2D([], [], color=s.colour, marker=s.marker, linestyle="", label=s.fit.model) for s in fits
    }
    origins = {s.origin: Line2D([], [], color="0.3", linestyle=s.line, label=s.origin) for s in fits}
    entries = [*handles.values(), *(origins.values() if len(origins) > 1 else [])]
    drawing.legend(handles=entries, loc="outside lower center", ncols=4)


def _values(contents: DatasetContents) -> dict[str, Any] | None:
    if not contents.simulated:
        return None
    caption = (
        "Error of each fit in each state: the root mean square of the distances between simulated and "
        "measured beam. Bars: the error ± one standard deviation of the distances."
    )
    if len(contents.simulated) > 1:
        first = contents.simulated[0].fitted_law.label
        caption += (
            " The fits of one state are drawn slightly apart, so that all can be seen. Below: the error of each fit "
            f"minus the error of {first}."
        )
    return {"picture": Picture("error_against_field", drawn_errors(contents.simulated), "error by state", caption)}


PANEL = DatasetPanel(place=20, title="Error against field", template="{{ picture | figure }}", values=_values)
