"""What makes up the interval of each modulus, and what to measure better next."""

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
    "The interval's parts: the standard deviation that each source by itself gives the initial shear modulus. Their "
    "squares add up, and an interval of 95 % is about twice the root of the sum to either side."
)
_MOST = 8  # sources drawn each on its own


def shares(fit: FitRecord) -> list[tuple[str, float]]:
    """What each source, the smaller ones together, and noise and mesh do to the modulus: standard deviations in %."""
    found = [(entry_words(entry, fit), entry.effect_percent) for entry in fit.budget[:_MOST]]
    smaller = [entry.effect_percent for entry in fit.budget[_MOST:]]
    if smaller:
        found.append(
            (f"{len(smaller)} smaller one{'s' * (len(smaller) > 1)}", float(np.sqrt(np.sum(np.square(smaller)))))
        )
    modulus = fit.initial_shear_modulus
    if modulus.interval_95_fit:
        low, high = modulus.interval_95_fit
        found.append(("noise and mesh", 100 * (high - low) / (2 * 1.96 * modulus.value)))
    return found


def drawn_budget(every: Sequence[tuple[ShownFit, FitRecord]]) -> Drawing:
    """A bar for each source, a row of axes for each fit."""
    rows = [shares(fit) for _, fit in every]
    drawing = Drawing(0.5 * len(rows) + 0.22 * sum(map(len, rows)) + 0.3)
    grid = drawing.subplots(len(rows), 1, sharex=True, squeeze=False, height_ratios=[len(row) + 1 for row in rows])
    for (shown, _), row, axes in zip(every, rows, grid[:, 0], strict=True):
        bars = axes.barh(range(len(row)), [size for _, size in row], color=shown.colour, height=0.7)
        axes.bar_label(bars, fmt="%.2g", padding=3, fontsize=8)
        axes.set_yticks(range(len(row)), [words for words, _ in row])
        axes.invert_yaxis()
        axes.grid(axis="y", visible=False)
        axes.margins(x=0.1)
        axes.set_title(shown.label, loc="left")
        label(axes, "standard deviation that it gives the initial shear modulus, %", "")
        axes.label_outer()
    return drawing


def _values(report: ReportContents) -> dict[str, Any] | None:
    every = [(shown, shown.fit) for shown in report.bending if isinstance(shown.fit, FitRecord)]
    if not every:
        return None
    stated = [(shown, fit) for shown, fit in every if fit.budget]
    return {
        "picture": Picture("budget", drawn_budget(stated), "share of each source in the interval", _CAPTION)
        if stated
        else None,
        "sentences": [(shown.label, next_sentence(fit)) for shown, fit in stated],
        "exact": [(shown.label, ", ".join(fit.taken_as_exact)) for shown, fit in every if fit.taken_as_exact],
    }


PANEL = ReportPanel(
    place=15,
    title="What the interval is made of",
    template="""
{% if picture %}
{{ picture | figure }}
{% endif %}
<ul>
{% for label, words in sentences %}<li><b>{{ label }}</b>: {{ words }}</li>{% endfor %}
{% for label, words in exact %}
<li><b>{{ label }}</b>: taken as exact, because no uncertainty is stated: {{ words }}.</li>
{% endfor %}
</ul>
{% if not picture %}<p class="note">No source is stated with an uncertainty above 0: the intervals hold noise and mesh
alone.</p>{% endif %}
""",
    values=_values,
    of_fits=True,
)
