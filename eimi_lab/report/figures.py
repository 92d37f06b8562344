"""The report's pictures: numbers in, PNG bytes out."""

from __future__ import annotations

import io
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from eimi_fitting.observation import EdgeObservation, PointObservation
from eimi_lab.dataset.reading import Dataset
from eimi_lab.identification.experiments import Evidence
from eimi_lab.identification.records import FitRecord
from eimi_lab.report.shown import ShownFit
from eimi_lab.report.simulation import Simulated
from eimi_lab.vision.beam_frame import BeamFrame

Array = NDArray[np.float64]

_MOST_FRAMES = 6
_MARGIN_PX = 40


def png(figure: Figure) -> bytes:
    """A figure as the bytes of a PNG file."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    return buffer.getvalue()


def tidy(axes: Axes, x: str, y: str) -> None:
    """Names on the axes, a faint grid, no frame."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)


def frames_with_edges(dataset: Dataset, evidence: Evidence, simulated: Simulated | None) -> bytes:
    """Frames of up to six states with the simulated edges over them, or with the measured ones; one crop for all."""
    observed = evidence.experiment.observed
    if dataset.calibration is None or not isinstance(observed, EdgeObservation):
        raise ValueError("tracked points have no frames")
    frame = BeamFrame(dataset.calibration)
    shown = np.unique(np.linspace(0, len(evidence.states) - 1, _MOST_FRAMES).round().astype(int))
    if simulated:
        lines = [[frame.to_px(side) for side in simulated.edges_mm[k]] for k in shown]
    else:
        seen = np.isfinite(observed.sigma_mm)
        lines = [[frame.to_px(observed.points_mm[k, i][seen[k, i]]) for i in range(2)] for k in shown]
    everywhere = np.concatenate([side for sides in lines for side in sides])
    images = [dataset.images(evidence.states[k].index)[0] for k in shown]
    height, width = images[0].shape[:2]
    left, top = np.maximum(everywhere.min(axis=0) - _MARGIN_PX, 0).astype(int)
    right, bottom = np.minimum(everywhere.max(axis=0) + _MARGIN_PX, [width - 1, height - 1]).astype(int)
    columns = min(3, len(shown))
    rows = -(-len(shown) // columns)
    figure = Figure(figsize=(9.5, 9.5 / columns * rows * (bottom - top) / (right - left)), layout="constrained")
    for place, (k, image, sides) in enumerate(zip(shown, images, lines, strict=True)):
        axes = figure.add_subplot(rows, columns, place + 1)
        axes.imshow(image[..., ::-1] if image.ndim == 3 else image, cmap="gray")
        for side in sides:
            axes.plot(*side.T, color="#FF8C1A", linewidth=1.6)
        axes.set_xlim(left, right)
        axes.set_ylim(bottom, top)
        axes.axis("off")
        state = evidence.states[k]
        error = f", error {1e3 * simulated.error_mm[k]:.1f} µm" if simulated else ""
        axes.set_title(f"{state.field_mT:.2f} mT{error}", fontsize=9)
    return png(figure)


def points_with_shape(evidence: Evidence, simulated: Simulated) -> bytes:
    """Tracked points at rest and moved, with the simulated beam."""
    observed = evidence.experiment.observed
    if not isinstance(observed, PointObservation):
        raise ValueError("frames have no tracked points")
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    axes = figure.add_subplot()
    for k, sides in enumerate(simulated.edges_mm):
        outline = np.concatenate([sides[0], sides[1][::-1]])
        shade = 0.25 + 0.6 * k / max(len(simulated.edges_mm) - 1, 1)
        axes.plot(*outline.T, color="#0072B2", alpha=shade, linewidth=1.2)
        seen = np.isfinite(observed.sigma_mm[k])
        axes.errorbar(
            observed.moved_mm[k, seen, 0],
            observed.moved_mm[k, seen, 1],
            xerr=observed.sigma_mm[k, seen],
            yerr=observed.sigma_mm[k, seen],
            fmt="o",
            color="#D55E00",
            alpha=shade,
            markersize=4,
            label=f"state {evidence.states[k].index}: measured",
        )
    axes.set_aspect("equal")
    axes.legend(frameon=False, fontsize=8)
    tidy(axes, "x along the beam, mm", "y across, mm")
    return png(figure)


def residuals_along_edge(simulated: Simulated) -> bytes:
    """Measured minus simulated along both edges, every state one line: what is left should look like noise."""
    figure = Figure(figsize=(9, 3.0), layout="constrained")
    states = len(simulated.residuals_mm)
    for side, name in enumerate(("left edge", "right edge")):
        axes = figure.add_subplot(1, 2, side + 1)
        for k, row in enumerate(simulated.residuals_mm[:, side]):
            axes.plot(1e3 * row, color="#0072B2", alpha=0.2 + 0.7 * k / max(states - 1, 1), linewidth=0.8)
        axes.set_title(name, fontsize=9)
        tidy(axes, "edge point, clamp to tip", "measured − simulated, µm")
    return png(figure)


def convergence(every: Sequence[ShownFit]) -> bytes:
    """Best error of each generation of each search."""
    figure = Figure(figsize=(6, 3.4), layout="constrained")
    axes = figure.add_subplot()
    for shown in every:
        if isinstance(shown.fit, FitRecord):
            best = [1e3 * generation.best_mm for generation in shown.fit.history]
            axes.semilogy(range(1, len(best) + 1), best, label=shown.label)
    axes.legend(frameon=False, fontsize=8)
    tidy(axes, "generation", "best mean error, µm")
    return png(figure)
