"""What the best fit leaves, as arrows on the beam in chosen states."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_fitting.inference.evidence.measurements import EdgeObservation
from eimi_lab.fits.simulated_fit import Prediction
from eimi_lab.reporting.contents import DatasetContents
from eimi_lab.reporting.elements import Picture
from eimi_lab.reporting.frames import load_words, some_states
from eimi_lab.reporting.panel import DatasetPanel
from eimi_lab.reporting.shown import ShownFit
from eimi_lab.showing.drawing import Drawing, label
from eimi_lab.showing.palette import MEASURED, PALETTE

Array = NDArray[np.float64]

_STATES = 3
_ARROWS = 40  # on each edge
_LONGEST = 0.9  # of the beam's width: how long the arrow of the largest residual but a few is drawn
_TYPICAL = 0.95  # quantile that stands for the largest


def residual_vectors(simulated: Prediction[ShownFit], k: int) -> tuple[Array, Array]:
    """(n, 2) where the measured points or markers of state k were seen, and (n, 2) measured minus simulated, in mm."""
    observed, residuals = simulated.evidence.experiment.observed, simulated.residuals_mm[k]
    if not isinstance(observed, EdgeObservation):
        seen = np.isfinite(observed.sigma_mm[k])
        return observed.moved_mm[k, seen], residuals[:, seen].T
    places, vectors = [], []
    for side in range(2):
        seen = np.flatnonzero(np.isfinite(residuals[side]))
        rows = seen[np.unique(np.linspace(0, len(seen) - 1, _ARROWS).astype(int))]
        points, edge = observed.points_mm[k, side, rows], simulated.edges_mm[k, side]
        tangent = np.gradient(edge, axis=0)[((points[:, None] - edge) ** 2).sum(axis=-1).argmin(axis=1)]
        normal = np.column_stack([-tangent[:, 1], tangent[:, 0]]) / np.linalg.norm(tangent, axis=1, keepdims=True)
        places.append(points)
        vectors.append(normal * residuals[side, rows, None])  # positive to the left of clamp-to-tip
    return np.concatenate(places), np.concatenate(vectors)


def drawn_residuals(contents: DatasetContents, simulated: Prediction[ShownFit]) -> tuple[Drawing, float]:
    """The simulated outline with arrows from it to what was measured, magnified; and how many times."""
    chosen = some_states(contents, _STATES)
    found = [residual_vectors(simulated, k) for k in chosen]
    sizes = np.concatenate([np.linalg.norm(vectors, axis=1) for _, vectors in found])
    width = contents.dataset.specimen.specimen.width_mm
    magnified = _round_down(_LONGEST * width / max(float(np.quantile(sizes, _TYPICAL)), 1e-9))
    outlines = [contents.dataset.upright(simulated.edges_mm[k]) for k in chosen]
    everywhere = np.concatenate([outline.reshape(-1, 2) for outline in outlines])
    span = np.ptp(everywhere, axis=0) + 2 * width
    drawing = Drawing(float(np.clip(7.1 / len(chosen) * span[1] / span[0] + 0.8, 2.0, 6.5)))
    grid = np.atleast_1d(drawing.subplots(1, len(chosen), sharex=True, sharey=True))
    for axes, k, outline, (places, vectors) in zip(grid, chosen, outlines, found, strict=True):
        left, right = outline
        axes.fill(*np.concatenate([left, right[::-1]]).T, facecolor="0.93", edgecolor=PALETTE[1], linewidth=1.0)
        start = contents.dataset.upright(places)
        arrows = magnified * contents.dataset.upright(vectors)
        axes.quiver(
            *start.T, *arrows.T, color=PALETTE[0], angles="xy", scale_units="xy", scale=1, width=0.006, headwidth=3
        )
        if not isinstance(simulated.evidence.experiment.observed, EdgeObservation):
            axes.plot(*start.T, "o", color=MEASURED, markersize=2.5)
        state = contents.evidence.states[k]
        axes.set_title(f"{load_words(state)}: {1e3 * simulated.error_mm[k]:.2g} µm")
        axes.set_aspect("equal")
        axes.set_xlim(everywhere[:, 0].min() - width, everywhere[:, 0].max() + width)
        axes.set_ylim(everywhere[:, 1].min() - width, everywhere[:, 1].max() + width)
        label(axes, "to the right, mm", "up, mm")
        axes.label_outer()
    return drawing, magnified


def _round_down(factor: float) -> float:
    """1, 2 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(max(factor, 1e-6)))
    return next(step * power for step in (5.0, 2.0, 1.0) if step * power <= factor * (1 + 1e-9))


def _values(contents: DatasetContents) -> dict[str, Any] | None:
    best = contents.best
    if best is None:
        return None
    drawn, magnified = drawn_residuals(contents, best)
    caption = (
        f"The beam as {best.fitted_law.label} has it (grey, outlined), and what that leaves: arrows to what was "
        f"measured, magnified {magnified:g} times. Above: the load, and the error of that state."
    )
    return {"best": best, "picture": Picture("residual_arrows", drawn, "residuals as arrows on the beam", caption)}


PANEL = DatasetPanel(
    place=30,
    title="Simulated and measured, the difference magnified",
    template="{{ picture | figure }}",
    values=_values,
)
