"""Show how much each source of uncertainty contributes to the interval of the modulus, and what to measure next."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from eimi_lab.fits.fit_summary import entry_words, next_sentence
from eimi_lab.fits.records import FitRecord
from eimi_lab.reporting.contents import ReportContents
from eimi_lab.reporting.elements import Picture
from eimi_lab.reporting.panel import ReportPanel
from eimi_lab.reporting.shown import ShownFit
from eimi_lab.showing.drawing import Drawing, label

_CAPTION = (
    "The standard deviation of the initial shear modulus due to each source of uncertainty alone. The standard "
    "deviation due to all sources is the root of the sum of squares. The 95 % interval extends about twice this value "
    "to each side."
)
_QUANTITY = ("standard deviation of the", "initial shear modulus, %")
_MOST = 8  # sources with a bar each; the others share a bar


def shares(fit: FitRecord) -> list[tuple[str, float]]:
    """Return the contributions to the uncertainty of the modulus: name, and standard deviation in % of the modulus.

    Small contributions are combined in one entry.
    """
    rows = [(entry_words(entry, fit), entry.effect_percent) for entry in fit.budget[:_MOST]]
    smaller = [entry.effect_percent for entry in fit.budget[_MOST:]]
    if smaller:
        words = f"{len(smaller)} smaller source{'s' * (len(smaller) > 1)}"
        rows.append((words, float(np.sqrt(np.sum(np.square(smaller))))))
    modulus = fit.initial_shear_modulus
    if modulus.interval_95_fit:
        low, high = modulus.interval_95_fit
        rows.append(("noise and mesh", 100 * (high - low) / (2 * 1.96 * modulus.value)))
    return rows


def drawn_budget(fits: Sequence[tuple[ShownFit, FitRecord]]) -> Drawing:
    """Draw bars for each fit: the standard deviation of the modulus that each source of uncertainty causes."""
    bars = [shares(fit) for _, fit in fits]
    columns = min(2, len(fits))
    most = [max(map(len, bars[first : first + columns])) for first in range(0, len(fits), columns)]
    drawing = Drawing(0.5 * len(most) + 0.22 * sum(most) + 0.3)
    grid = drawing.subplots(len(most), columns, sharex=True, squeeze=False, height_ratios=[many + 1 for many in most])
    for (shown, _), row, axes in zip(fits, bars, grid.flat, strict=False):
        drawn = axes.barh(range(len(row)), [size for _, size in row], color=shown.colour, height=0.7)
        axes.bar_label(drawn, fmt="%.2g", padding=3, fontsize=8)
        axes.set_yticks(range(len(row)), [words for words, _ in row])
        axes.invert_yaxis()
        axes.grid(axis="y", visible=False)
        axes.margins(x=0.1)
        axes.set_title(shown.label, loc="left")
    for axes in grid.flat[max(0, len(fits) - columns) : len(fits)]:  # the lowest axes of each column
        label(axes, ("\n" if columns > 1 else " ").join(_QUANTITY), "")
        axes.tick_params(labelbottom=True)
    for axes in grid.flat[len(fits) :]:
        axes.set_axis_off()
    return drawing


def _values(report: ReportContents) -> dict[str, Any] | None:
    fits = [(shown, shown.fit) for shown in report.bending if isinstance(shown.fit, FitRecord)]
    if not fits:
        return None
    with_budget = [(shown, fit) for shown, fit in fits if fit.budget]
    return {
        "picture": Picture("budget", drawn_budget(with_budget), "share of each source in the interval", _CAPTION)
        if with_budget
        else None,
        "sentences": [(shown.label, next_sentence(fit)) for shown, fit in with_budget],
        "exact": [(shown.label, ", ".join(fit.taken_as_exact)) for shown, fit in fits if fit.taken_as_exact],
    }


PANEL = ReportPanel(
    place=15,
    title="Uncertainty budget",
    template="""
{% if picture %}
{{ picture | figure }}
{% endif %}
<ul>
{% for label, words in sentences %}<li><b>{{ label }}</b>: {{ words }}</li>{% endfor %}
{% for label, words in exact %}
<li><b>{{ label }}</b>: taken as exact, because no uncertainty is given: {{ words }}.</li>
{% endfor %}
</ul>
{% if not picture %}<p class="note">No uncertainty above 0 is given: the intervals include noise and mesh
only.</p>{% endif %}
""",
    values=_values,
    of_fits=True,
)
