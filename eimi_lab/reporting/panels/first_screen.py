"""Show the result first: modulus, interval, largest source of uncertainty, reliability, and a picture of the beam."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from eimi_fitting.inference.evidence.measurements import PointObservation
from eimi_lab.fits.simulated_fit import Prediction
from eimi_lab.reporting.contents import DatasetContents, ReportContents
from eimi_lab.reporting.elements import Picture
from eimi_lab.reporting.error_at_a_glance import WIDTH_IN, error_at_a_glance
from eimi_lab.reporting.findings import findings
from eimi_lab.reporting.frames import Crop, crop_of, frame_of, load_words, measured_mm, some_states
from eimi_lab.reporting.panel import ReportPanel
from eimi_lab.reporting.shown import ShownFit
from eimi_lab.showing.drawing import Drawing, label
from eimi_lab.showing.palette import MEASURED, PALETTE

_POINTS = 18  # measured points drawn on each edge, so few that the frame remains visible
_SIMULATED, _DOTS = PALETTE[1], PALETTE[0]
_CLOSE = 0.62  # width over height of the close-up of the tip
_LAST = 6  # the close-up shows the last 1/6 of the edges


def edges_over_frames(contents: DatasetContents, simulated: Prediction[ShownFit] | None) -> Drawing:
    """Draw measured edges (dots) and simulated edges (lines) over images of the beam, at small and large load."""
    crop = crop_of(contents)
    states = some_states(contents, 2)
    tall = crop.height_over_width
    drawing = Drawing(WIDTH_IN / (len(states) + tall * _CLOSE) * tall + 0.45, WIDTH_IN)
    grid = drawing.subplots(1, len(states) + 1, width_ratios=[*(1.0 for _ in states), tall * _CLOSE])
    for axes, k in zip(grid, [*states, states[-1]], strict=True):
        close = axes is grid[-1]
        _draw(axes, contents, simulated, k, crop, points=None if close else _POINTS)
        axes.set_title("tip" if close else load_words(contents.evidence.states[k]))
        if close:
            _look_at_tip(axes, contents, k, crop)
    handles = [Line2D([], [], marker="o", linestyle="", color=_DOTS, label="measured")]
    if simulated:
        handles.append(Line2D([], [], color=_SIMULATED, label=f"simulated, {simulated.fitted_law.fit.model}"))
    drawing.legend(handles=handles, loc="outside lower center", ncols=2)
    return drawing


def _draw(
    axes: Axes,
    contents: DatasetContents,
    simulated: Prediction[ShownFit] | None,
    k: int,
    crop: Crop,
    points: int | None,
) -> None:
    """Draw the image of a load step, with the measured and the simulated edges.

    `k` is the index among the load steps of the fit. `points` is the number of drawn points on each edge; None for all.
    """
    frame, image = frame_of(contents), contents.dataset.images(contents.evidence.states[k].index, 1)[0]
    axes.imshow(crop.of(image), cmap="gray", vmin=0, vmax=1)
    for side, measured in enumerate(measured_mm(contents, k)):
        if simulated:
            axes.plot(*crop.places(frame.to_px(simulated.edges_mm[k, side])).T, color=_SIMULATED, linewidth=1.5)
        rows = np.unique(np.linspace(0, len(measured) - 1, points or len(measured)).astype(int))
        places = crop.places(frame.to_px(measured[rows]))
        axes.plot(*places.T, "o", color=_DOTS, markersize=3, markeredgewidth=0.4, markeredgecolor="white")
    axes.axis("off")
    axes.set_xlim(0, crop.right - crop.left)
    axes.set_ylim(crop.bottom - crop.top, 0)


def _look_at_tip(axes: Axes, contents: DatasetContents, k: int, crop: Crop) -> None:
    """Set the limits of the axes so that they show the tip of the beam at load step `k`."""
    ends = np.concatenate([points[-len(points) // _LAST :] for points in measured_mm(contents, k)])
    places = crop.places(frame_of(contents).to_px(ends))
    middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
    half = 0.62 * float(np.ptp(places, axis=0).max())
    axes.set_xlim(middle[0] - half, middle[0] + half)
    axes.set_ylim(middle[1] + half / _CLOSE, middle[1] - half / _CLOSE)


def points_over_outlines(contents: DatasetContents, simulated: Prediction[ShownFit] | None) -> Drawing:
    """Draw the tracked points and the simulated outlines at the smallest, a middle and the largest load."""
    observed = contents.evidence.experiment.observed
    if not isinstance(observed, PointObservation):
        raise ValueError("frames have no tracked points")
    drawing = Drawing(3.6, WIDTH_IN)
    axes = drawing.subplots()
    for k, marker in zip(some_states(contents, 3), "osD", strict=False):
        if simulated:
            left, right = contents.dataset.upright(simulated.edges_mm[k])
            axes.plot(*np.concatenate([left, right[::-1], left[:1]]).T, color=_SIMULATED, linewidth=1.2)
        measured = np.isfinite(observed.sigma_mm[k])
        words = load_words(contents.evidence.states[k])
        places = contents.dataset.upright(observed.moved_mm[k, measured])
        axes.plot(*places.T, marker, color=MEASURED, markersize=3.5, label=f"tracked, {words}")
    if simulated:
        axes.plot([], [], color=_SIMULATED, label=f"simulated, {simulated.fitted_law.fit.model}")
    axes.set_aspect("equal")
    label(axes, "to the right, mm", "up, mm")
    drawing.legend(loc="outside lower center", ncols=2)
    return drawing


def picture_of(report: ReportContents) -> Picture | None:
    """Return the picture of the beam for the first page of a report; None without datasets."""
    results = findings(report)
    best_fit = results[0].shown if results else None
    for contents in report.datasets:
        simulated = contents.simulated_by(best_fit)
        if simulated or best_fit is None or contents is report.datasets[-1]:
            frames = contents.dataset.kind == "frames"
            drawn = (edges_over_frames if frames else points_over_outlines)(contents, simulated)
            words = "measured and simulated" if simulated else "measured"
            middle = ", a middle" * (not frames and len(some_states(contents, 3)) > 2)
            caption = f"{contents.name}: the beam, {words}, at the smallest{middle} and the largest load"
            caption += ", and its tip at the largest load." if frames else "."
            return Picture("result", drawn, "measured and simulated beam", caption, frames, of_half_width=True)
    return None


def _values(report: ReportContents) -> dict[str, Any]:
    return {
        "findings": findings(report),
        "picture": picture_of(report),
        "error": error_at_a_glance(report),
        "datasets": report.datasets,
    }


PANEL = ReportPanel(
    place=0,
    summary=True,
    title="",
    template="""
{% macro result(f) %}
<div>
<p class="number">{% if f.subject %}{{ f.subject }}: initial{% else %}Initial{% endif %} shear modulus
<b>{{ f.value }}</b> (95 % interval: {{ f.interval }}){{ f.doubt }}, {{ f.how }}. {{ f.limit }}</p>
<dl class="verdicts">
{% for v in f.verdicts %}<dt>{{ v.question }} <span>{{ v.answer }}</span></dt><dd>{{ v.words }}</dd>
{% endfor %}
</dl>
</div>
{% endmacro %}
<div class="answer">
<div class="pictures">
{% if picture %}{{ picture | figure }}{% endif %}
{% if error %}{{ error | figure }}{% endif %}
</div>
{% for f in findings[:1] %}{{ result(f) }}{% endfor %}
{% if not findings %}<div>{% for d in datasets %}<p class="number">{{ d.name }}: {{ d.evidence.used.in_words() }}.
No law was fitted.</p>{% endfor %}</div>{% endif %}
</div>
{% if findings | length > 1 %}
<div class="further">{% for f in findings[1:] %}{{ result(f) }}{% endfor %}</div>
{% endif %}
""",
    values=_values,
)
