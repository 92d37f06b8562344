"""The report's pictures with a panel a law: errors by state, shapes, stress against strain."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from eimi_fitting.observation import EdgeObservation
from eimi_lab.identification.experiments import Evidence
from eimi_lab.report.figures import png, tidy
from eimi_lab.report.shown import ShownFit
from eimi_lab.report.simulation import Simulated
from eimi_lab.report.stress import StressCurve, TensilePoints

Array = NDArray[np.float64]

_LOG_FROM = 20  # largest over smallest mean error beyond which errors are drawn on a logarithmic axis


def _panels(every: Sequence[ShownFit], height_over_width: float) -> tuple[Figure, Iterator[tuple[str, Axes]]]:
    """A panel for each law, at most two abreast, with common axes."""
    names = list(dict.fromkeys(shown.fit.model for shown in every))
    columns = min(2, len(names))
    rows = -(-len(names) // columns)
    width = 4.8 if columns == 2 else 7.0
    size = (width * columns, (width * height_over_width + 0.4) * rows + 0.5)
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for unused in grid[len(names) :]:
        unused.axis("off")
    return figure, zip(names, grid, strict=False)


def _legend(figure: Figure) -> None:
    """One legend below all panels, each name once."""
    entries: dict[str, Any] = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    columns = 3 if len(figure.axes) == 1 else 5
    handles, labels = list(entries.values()), list(entries)
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False, fontsize=8)


def errors_by_state(all_simulated: Sequence[Simulated]) -> bytes:
    """Error of each fit with a band of one deviation, against the field or, where that does not change, the state."""
    states = all_simulated[0].evidence.states
    fields = np.array([state.field_mT for state in states])
    by_field = np.ptp(fields) > 0
    x = fields if by_field else np.array([state.index for state in states])
    means = [s.error_mm.mean() for s in all_simulated]
    logarithmic = max(means) > _LOG_FROM * min(means)
    figure, panels = _panels([s.shown for s in all_simulated], 0.5)
    for model, axes in panels:
        for s in all_simulated:
            if s.shown.fit.model != model:
                continue
            error, deviation = 1e3 * s.error_mm, 1e3 * s.deviation_mm
            # On a logarithmic axis a band down to zero would have no end.
            lowest = np.maximum(error - deviation, 0.1 * error if logarithmic else 0.0)
            axes.fill_between(x, lowest, error + deviation, color=s.shown.colour, alpha=0.15, linewidth=0)
            axes.plot(x, error, "o-", color=s.shown.colour, markersize=3, linewidth=1.2, label=s.shown.origin)
        axes.set_title(model, fontsize=9)
        if not by_field:
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        if logarithmic:
            axes.set_yscale("log")
        else:
            axes.set_ylim(bottom=0)
        tidy(axes, "field, mT" if by_field else "state", "error, µm")
        axes.label_outer()
    _legend(figure)
    return png(figure)


def shapes_in_largest_state(evidence: Evidence, all_simulated: Sequence[Simulated]) -> tuple[bytes, str]:
    """Simulated edges over the measured ones or tracked points, in the state of the largest load; and its name."""
    loads = np.abs([(s.field_mT, s.tip_force_N) for s in evidence.states])
    k = int(np.argmax((loads / np.maximum(loads.max(axis=0), 1e-12)).sum(axis=1)))
    state = evidence.states[k]
    observed = evidence.experiment.observed
    seen = np.isfinite(observed.sigma_mm[k])
    if isinstance(observed, EdgeObservation):
        measured, mark = observed.points_mm[k][seen], "."
    else:
        measured, mark = observed.moved_mm[k][seen], "x"
    figure, panels = _panels([s.shown for s in all_simulated], _height_over_width(measured))
    for model, axes in panels:
        for s in all_simulated:
            if s.shown.fit.model == model:
                left, right = s.edges_mm[k]
                outline = np.concatenate([left, right[::-1]])
                axes.plot(*outline.T, color=s.shown.colour, linewidth=1.0, label=s.shown.origin)
        axes.plot(*measured.T, mark, color="black", markersize=2.5 if mark == "." else 7, label="measured", zorder=5)
        axes.set_aspect("equal")
        axes.set_title(model, fontsize=9)
        tidy(axes, "x along the beam at rest, mm", "y, mm")
        axes.label_outer()
    _legend(figure)
    force = f", {state.tip_force_N:.3g} N" if state.tip_force_N else ""
    return png(figure), f"state {state.index}: {state.field_mT:.2f} mT{force}"


def _height_over_width(points: Array) -> float:
    """Of a panel that holds the points (n, 2) with equal scales and room for titles."""
    width, height = np.ptp(points, axis=0)
    return float(np.clip(1.2 * height / max(width, 1e-9) + 0.1, 0.35, 1.0))


def stress_curves(curves: Sequence[StressCurve], points: Sequence[TensilePoints], reached: float | None) -> bytes:
    """Engineering stress in uniaxial tension: lines solid as far as a fit's data went, dashed beyond.

    reached: the largest engineering strain in any bent specimen; the plane beyond it is shaded.
    """
    figure, panels = _panels([curve.shown for curve in curves], 0.55)
    largest = 100 * float(curves[0].strain[-1])
    top = 0.0
    for model, axes in panels:
        if reached is not None and 100 * reached < largest:
            axes.axvspan(100 * reached, largest, color="0.93", zorder=0)
        for test in points:
            axes.plot(100 * test.strain, 1e-3 * test.stress_Pa, ".", color="0.35", markersize=4, label=test.label)
            top = max(top, float(test.stress_Pa.max()))
        for curve in curves:
            if curve.shown.fit.model != model:
                continue
            strain, stress, colour = 100 * curve.strain, 1e-3 * curve.stress_Pa, curve.shown.colour
            within = curve.strain <= curve.reached + 1e-9
            # Beyond their own data tensile fits are no more than dashed: their bands would hide everything else.
            shown = within | (curve.shown.fit.kind == "bending")
            axes.fill_between(strain[shown], *(1e-3 * curve.band_Pa[shown].T), color=colour, alpha=0.18, linewidth=0)
            axes.plot(strain, stress, "--", color=colour, linewidth=0.9)
            axes.plot(strain[within], stress[within], color=colour, linewidth=1.5, label=curve.shown.origin)
            if not points:
                top = max(top, float(curve.stress_Pa.max()))
        axes.set_title(model, fontsize=9)
        axes.set_xlim(0, largest)
        tidy(axes, "engineering strain, %", "engineering stress, kPa")
        axes.label_outer()
    figure.axes[0].set_ylim(-0.1e-3 * top, 1.5e-3 * top)
    _legend(figure)
    return png(figure)
