"""Show stress against strain for each law in three modes of deformation, with the measured tensile tests."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from numpy.typing import NDArray

from eimi_lab.reporting.contents import ReportContents
from eimi_lab.reporting.elements import Picture
from eimi_lab.reporting.panel import ReportPanel
from eimi_lab.reporting.shown import ShownFit
from eimi_lab.reporting.stress import (
    BAND,
    MODES,
    UNIAXIAL,
    Mode,
    StressCurve,
    TensilePoints,
    bending_strain,
    largest_strain,
    reached,
    stress_curve,
    tensile_points,
)
from eimi_lab.showing.drawing import Drawing, label

Array = NDArray[np.float64]

_STRAINS = 61
_MOST_PERCENT = 50.0  # of difference in the panel of differences
_ROWS = 2  # kinds of fitted data in a figure; low figures leave less of a printed page empty
_HEADROOM = 1.5  # upper limit of the axis, relative to the largest measured stress


def drawn_stress(
    fits: Sequence[ShownFit],
    points: Sequence[TensilePoints],
    bent_to: float | None,
    origins: Sequence[str] | None = None,
) -> Drawing:
    """Draw stress against strain: a column for each mode of deformation, a row for each kind of fitted data.

    Parameters
    ----------
    fits : sequence of ShownFit
        The fits of the report.
    points : sequence of TensilePoints
        Measured points of tensile tests.
    bent_to : float or None
        The largest strain of a bent specimen.
    origins : sequence of str, optional
        The kinds of fitted data to draw; by default all kinds.
    """
    every_origin = _origins(fits)
    origins = every_origin if origins is None else origins
    compared = len(fits) > 1 and origins[-1] == every_origin[-1]
    height_in = 1.7 if len(every_origin) <= _ROWS else 1.3
    drawing = Drawing(height_in * len(origins) + 1.2 * compared + 0.5)
    rows = len(origins) + compared
    heights = [1.0] * len(origins) + [0.7] * compared
    grid = drawing.subplots(rows, len(MODES), sharex=True, sharey="row", squeeze=False, height_ratios=heights)
    comparison = grid[-1] if compared else []
    strain = np.linspace(0, largest_strain(fits), _STRAINS)
    top = _top(fits, points, strain)
    for axes, mode in zip(comparison, MODES, strict=False):
        _draw_ratios(axes, fits, strain, mode)
        label(axes, mode.strain + ", %", f"relative to\n{fits[0].fit.model}, %")
        axes.label_outer()
    for row, origin in zip(grid[: len(origins)], origins, strict=True):
        for axes, mode in zip(row, MODES, strict=True):
            if bent_to is not None and mode.at_stretch(1 + bent_to) < strain[-1]:
                axes.axvspan(100 * mode.at_stretch(1 + bent_to), 100 * strain[-1], color="0.92", zorder=0)
            if mode is UNIAXIAL:
                for test, marker in zip(points, ".x+12", strict=False):
                    axes.plot(
                        100 * test.strain, 1e-3 * test.stress_Pa, marker, color="0.3", markersize=3, label=test.label
                    )
            for shown in fits:
                if shown.origin == origin:
                    _draw(axes, stress_curve(shown, _strains_of(shown, strain, mode), mode), reached(shown, mode))
            label(axes, mode.strain + ", %", "\n".join([*wrap(f"fitted to {origin}", 18), "stress, kPa"]))
            axes.set_xlim(0, 100 * strain[-1])
            axes.label_outer()
    for axes, mode in zip(grid[0], MODES, strict=True):
        axes.set_title(mode.words)
    for row in grid[: len(origins)]:
        row[0].set_ylim(-0.02e-3 * top, _HEADROOM * 1e-3 * top if points else 1.1e-3 * top)
    _legend(drawing, [axes for row in grid for axes in row])
    return drawing


def _origins(fits: Sequence[ShownFit]) -> list[str]:
    return list(dict.fromkeys(shown.origin for shown in fits))


def _strains_of(shown: ShownFit, strain: Array, mode: Mode) -> Array:
    # The solid part of a curve ends at the largest strain of the data, which is therefore one of the strains.
    end = reached(shown, mode)
    return np.union1d(strain, [end] if end < strain[-1] else [])


def _top(fits: Sequence[ShownFit], points: Sequence[TensilePoints], strain: Array) -> float:
    """Return the largest stress (Pa) that is measured or, without measured points, computed at `strain`, shape (n,)."""
    if points:
        return max(float(test.stress_Pa.max(initial=0)) for test in points)
    curves = [stress_curve(shown, _strains_of(shown, strain, mode), mode) for shown in fits for mode in MODES]
    return max(float(curve.stress_Pa.max()) for curve in curves)


def _draw(axes: Axes, curve: StressCurve, end: float) -> None:
    strain, stress, shown = 100 * curve.strain, 1e-3 * curve.stress_Pa, curve.shown
    within = curve.strain <= end + 1e-9
    # The bands of tensile fits end with their data: beyond, they would hide all other lines.
    banded = within | (shown.fit.kind == "bending")
    low, high = (np.column_stack([strain[banded], end]) for end in 1e-3 * curve.band_Pa[banded].T)
    if shown.fit.draws:
        band = PolyCollection([np.concatenate([low, high[::-1]])], color=shown.colour, alpha=0.18, linewidth=0)
        axes.add_collection(band, autolim=False)  # computing limits, which are set later, takes longer than drawing
    axes.plot(strain, stress, "--", color=shown.colour, linewidth=0.8)
    axes.plot(strain[within], stress[within], color=shown.colour, linewidth=1.8, label=shown.fit.model)


def _draw_ratios(axes: Axes, fits: Sequence[ShownFit], strain: Array, mode: Mode) -> None:
    """Draw the relative difference (%) of the stress of each fit from the stress of the first fit."""
    nonzero = strain[1:]
    curves = [stress_curve(shown, nonzero, mode) for shown in fits]
    for shown, curve in zip(fits, curves, strict=True):
        percent = 100 * (curve.stress_Pa / curves[0].stress_Pa - 1)
        within = nonzero <= reached(shown, mode) + 1e-9
        axes.plot(100 * nonzero, percent, "--", color=shown.colour, linewidth=0.8)
        axes.plot(100 * nonzero[within], percent[within], color=shown.colour, linewidth=1.8)
    drawn = np.concatenate([line.get_ydata() for line in axes.lines])
    largest = float(np.abs(drawn[np.isfinite(drawn)]).max(initial=0.1))
    axes.set_ylim(-min(1.1 * largest, _MOST_PERCENT), min(1.1 * largest, _MOST_PERCENT))


def _legend(drawing: Drawing, all_axes: Sequence[Axes]) -> None:
    entries: dict[str, Any] = {}
    for axes in all_axes:
        for handle, words in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(words, handle)
    drawing.legend(list(entries.values()), list(entries), loc="outside lower center", ncols=4)


def _values(report: ReportContents) -> dict[str, Any] | None:
    if not report.fits:
        return None
    points, missing = tensile_points(report.fits, largest_strain(report.fits))
    bent_to = bending_strain(report.fits)
    words = "Engineering stress of each law: solid within the data of the fit, dashed beyond."
    if bent_to:
        words += (
            f" Shaded: strains beyond {100 * bent_to:.1f} % (or the shear with the same stretch), the largest strain "
            "of any bent specimen. There a law identified by bending is an extrapolation."
        )
    last_row = f"Last row: relative difference of the stress from the stress of {report.fits[0].label}."
    origins = _origins(report.fits)
    pictures = []
    for first in range(0, len(origins), _ROWS):
        shown = origins[first : first + _ROWS]
        caption = [f"Laws fitted to {' and '.join(shown)}."] if len(origins) > _ROWS else []
        caption += ["Drawn as in the figure before."] if first else [words]
        caption += [last_row] if len(report.fits) > 1 and shown[-1] == origins[-1] else []
        caption += [] if first else [BAND, *missing]
        drawn = drawn_stress(report.fits, points, bent_to, shown)
        pictures.append(Picture("stress_strain", drawn, "stress against strain of each law", " ".join(caption)))
    return {"pictures": pictures}


PANEL = ReportPanel(
    place=20,
    title="Stress against strain",
    template="{% for picture in pictures %}{{ picture | figure }}{% endfor %}",
    values=_values,
    of_fits=True,
)
