"""Stress against strain of every law in three ways of stretching, over the tensile tests where they are there."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from eimi_lab.reporting.contents import ReportContents
from eimi_lab.reporting.elements import Picture
from eimi_lab.reporting.panel import ReportPanel
from eimi_lab.reporting.shown import ShownFit
from eimi_lab.reporting.stress import (
    BAND,
    MODES,
    UNIAXIAL,
    StressCurve,
    TensilePoints,
    bending_strain,
    largest_strain,
    reached,
    stress_curve,
    tensile_points,
)
from eimi_lab.showing.drawing import Drawing, label

_STRAINS = 61
_HEADROOM = 1.5  # above the measured stresses: a law that has left them need not be followed


def drawn_stress(every: Sequence[ShownFit], points: Sequence[TensilePoints], bent_to: float | None) -> Drawing:
    """Three ways of stretching abreast, a row for what the laws were fitted to.

    Lines are solid as far as a fit's data went, thin and dashed beyond; what no bent specimen reached is shaded.
    """
    origins = list(dict.fromkeys(shown.origin for shown in every))
    drawing = Drawing(2.1 * len(origins) + 0.6)
    grid = drawing.subplots(len(origins), len(MODES), sharex=True, sharey=True, squeeze=False)
    strain = np.linspace(0, largest_strain(every), _STRAINS)
    top = max((float(test.stress_Pa.max(initial=0)) for test in points), default=0.0)
    for row, origin in zip(grid, origins, strict=True):
        for axes, mode in zip(row, MODES, strict=True):
            if bent_to is not None and mode.at_stretch(1 + bent_to) < strain[-1]:
                axes.axvspan(100 * mode.at_stretch(1 + bent_to), 100 * strain[-1], color="0.92", zorder=0)
            if mode is UNIAXIAL:
                for test, marker in zip(points, ".x+12", strict=False):
                    axes.plot(
                        100 * test.strain, 1e-3 * test.stress_Pa, marker, color="0.3", markersize=3, label=test.label
                    )
            for shown in every:
                if shown.origin == origin:
                    end = reached(shown, mode)
                    curve = stress_curve(shown, np.union1d(strain, [end] if end < strain[-1] else []), mode)
                    _draw(axes, curve, end)
                    top = top if points else max(top, float(curve.stress_Pa.max()))
            label(axes, mode.strain + ", %", "\n".join([*wrap(f"fitted to {origin}", 30), "stress, kPa"]))
            axes.set_xlim(0, 100 * strain[-1])
            axes.label_outer()
    for axes, mode in zip(grid[0], MODES, strict=True):
        axes.set_title(mode.words)
    grid[0, 0].set_ylim(-0.02e-3 * top, _HEADROOM * 1e-3 * top if points else 1.1e-3 * top)
    _legend(drawing, [axes for row in grid for axes in row])
    return drawing


def _draw(axes: Axes, curve: StressCurve, end: float) -> None:
    strain, stress, shown = 100 * curve.strain, 1e-3 * curve.stress_Pa, curve.shown
    within = curve.strain <= end + 1e-9
    # Beyond their own data tensile fits are no more than dashed: their bands would hide everything else.
    banded = within | (shown.fit.kind == "bending")
    low, high = (np.column_stack([strain[banded], end]) for end in 1e-3 * curve.band_Pa[banded].T)
    if shown.fit.draws:
        band = PolyCollection([np.concatenate([low, high[::-1]])], color=shown.colour, alpha=0.18, linewidth=0)
        axes.add_collection(band, autolim=False)  # the limits are set, and looking for them takes longer than drawing
    axes.plot(strain, stress, "--", color=shown.colour, linewidth=0.8)
    axes.plot(strain[within], stress[within], color=shown.colour, linewidth=1.8, label=shown.fit.model)


def _legend(drawing: Drawing, every: Sequence[Axes]) -> None:
    entries: dict[str, Any] = {}
    for axes in every:
        for handle, words in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(words, handle)
    drawing.legend(list(entries.values()), list(entries), loc="outside lower center", ncols=4)


def _values(report: ReportContents) -> dict[str, Any] | None:
    if not report.every:
        return None
    points, missing = tensile_points(report.every, largest_strain(report.every))
    bent_to = bending_strain(report.every)
    words = "Engineering stress of each law; solid as far as its own data went, dashed beyond."
    if bent_to:
        words += (
            f" Shaded: beyond {100 * bent_to:.1f} % strain (or the shear that stretches as much), the largest in any "
            "bent specimen; there a law identified by bending is an extrapolation."
        )
    caption = " ".join([words, BAND, *missing])
    drawn = drawn_stress(report.every, points, bent_to)
    return {"picture": Picture("stress_strain", drawn, "stress against strain of every law", caption)}


PANEL = ReportPanel(
    place=20, title="Stress against strain", template="{{ picture | figure }}", values=_values, of_fits=True
)
