"""Error of every fit in every state of a dataset."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from eimi_lab.fits.simulated_fit import Prediction
from eimi_lab.reporting.contents import DatasetContents
from eimi_lab.reporting.elements import Picture
from eimi_lab.reporting.panel import DatasetPanel
from eimi_lab.reporting.shown import ShownFit
from eimi_lab.showing.drawing import Drawing, by_field, label, plain_logarithm

_LOG_FROM = 20  # largest over smallest mean error beyond which errors are drawn on a logarithmic axis
_APART = 0.5  # of the least distance between two states: how far the fits of one state are moved apart in all


def drawn_errors(every: Sequence[Prediction[ShownFit]]) -> Drawing:
    """All fits in one panel, against the field or, where that does not change, the state; bars are one deviation."""
    states = every[0].evidence.states
    x, words = by_field([state.field_mT for state in states], [state.index for state in states])
    gaps = np.diff(np.unique(x))
    apart = _APART * float(gaps.min()) if len(gaps) else 1.0
    means = [float(s.error_mm.mean()) for s in every]
    logarithmic = max(means) > _LOG_FROM * max(min(means), 1e-9)
    drawing = Drawing(3.6)
    axes: Axes = drawing.subplots()
    for place, s in enumerate(every):
        error, deviation = 1e3 * s.error_mm, 1e3 * s.deviation_mm
        # On a logarithmic axis a bar down to zero would have no end.
        below = error - np.maximum(error - deviation, 0.1 * error if logarithmic else 0.0)
        axes.errorbar(
            x + apart * (place / max(len(every) - 1, 1) - 0.5) * (len(every) > 1),
            error,
            yerr=[below, deviation],
            color=s.fitted_law.colour,
            marker=s.fitted_law.marker,
            linestyle=s.fitted_law.line,
            linewidth=1.1,
            elinewidth=0.8,
            capsize=1.5,
        )
    if words == "state":
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    if logarithmic:
        axes.set_yscale("log")
        plain_logarithm(axes)
    else:
        axes.set_ylim(bottom=0)
    label(axes, words, "error, µm")
    legend_of_fits(drawing, [s.fitted_law for s in every])
    return drawing


def legend_of_fits(drawing: Drawing, every: Sequence[ShownFit]) -> None:
    """Colours and marks of the laws, and beside them lines of what they were fitted to where that differs."""
    handles = {
        s.fit.model: Line2D([], [], color=s.colour, marker=s.marker, linestyle="", label=s.fit.model) for s in every
    }
    origins = {s.origin: Line2D([], [], color="0.3", linestyle=s.line, label=s.origin) for s in every}
    entries = [*handles.values(), *(origins.values() if len(origins) > 1 else [])]
    drawing.legend(handles=entries, loc="outside lower center", ncols=4)


def _values(contents: DatasetContents) -> dict[str, Any] | None:
    if not contents.simulated:
        return None
    caption = "Error of every fit in every state; bars are one deviation, the scatter of the distances along the edges."
    if len(contents.simulated) > 1:
        caption += " The fits of a state stand a little beside one another, so that none hides another."
    return {"picture": Picture("error_against_field", drawn_errors(contents.simulated), "error by state", caption)}


PANEL = DatasetPanel(place=20, title="Error against field", template="{{ picture | figure }}", values=_values)
