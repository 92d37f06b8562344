"""Show the residuals of the best fit (measured minus simulated positions) as magnified arrows on the beam."""

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
_WIDTH_IN = 5.2  # width of the figure, so narrow that its caption stands beside it
_ARROWS = 40  # on each edge
_LONGEST = 0.9  # length of the arrow of a large residual, as a fraction of the beam's width
_LARGE = 0.95  # quantile of the residuals that counts as a large one


def residual_vectors(simulated: Prediction[ShownFit], k: int) -> tuple[Array, Array]:
    """Return the residuals of a fit at a load step as vectors at n measured points.

    Parameters
    ----------
    simulated : Prediction
        The simulation of a dataset.
    k : int
        Index of the load step.

    Returns
    -------
    places_mm : ndarray, shape (n, 2)
        Measured points: x along the straight beam, y across.
    vectors_mm : ndarray, shape (n, 2)
        x and y components of measured minus simulated position.
    """
    observed, residuals = simulated.evidence.experiment.observed, simulated.residuals_mm[k]
    if not isinstance(observed, EdgeObservation):
        measured = np.isfinite(observed.sigma_mm[k])
        return observed.moved_mm[k, measured], residuals[:, measured].T
    places, vectors = [], []
    for side in range(2):
        measured = np.flatnonzero(np.isfinite(residuals[side]))
        rows = measured[np.unique(np.linspace(0, len(measured) - 1, _ARROWS).astype(int))]
        points, edge = observed.points_mm[k, side, rows], simulated.edges_mm[k, side]
        tangent = np.gradient(edge, axis=0)[((points[:, None] - edge) ** 2).sum(axis=-1).argmin(axis=1)]
        normal = np.column_stack([-tangent[:, 1], tangent[:, 0]]) / np.linalg.norm(tangent, axis=1, keepdims=True)
        places.append(points)
        vectors.append(normal * residuals[side, rows, None])  # positive to the left, seen from the clamp to the tip
    return np.concatenate(places), np.concatenate(vectors)


def drawn_residuals(contents: DatasetContents, simulated: Prediction[ShownFit]) -> tuple[Drawing, float]:
    """Draw the simulated outlines with magnified arrows to the measured points, and return the magnification too."""
    chosen = some_states(contents, _STATES)
    residuals = [residual_vectors(simulated, k) for k in chosen]
    sizes = np.concatenate([np.linalg.norm(vectors, axis=1) for _, vectors in residuals])
    width = contents.dataset.specimen.specimen.width_mm
    magnification = _round_down(_LONGEST * width / max(float(np.quantile(sizes, _LARGE)), 1e-9))
    outlines = [contents.dataset.upright(simulated.edges_mm[k]) for k in chosen]
    everywhere = np.concatenate([outline.reshape(-1, 2) for outline in outlines])
    span = np.ptp(everywhere, axis=0) + 2 * width
    drawing = Drawing(float(np.clip(_WIDTH_IN / len(chosen) * span[1] / span[0] + 0.8, 1.8, 2.9)), _WIDTH_IN)
    grid = np.atleast_1d(drawing.subplots(1, len(chosen), sharex=True, sharey=True))
    for axes, k, outline, (places, vectors) in zip(grid, chosen, outlines, residuals, strict=True):
        left, right = outline
        axes.fill(*np.concatenate([left, right[::-1]]).T, facecolor="0.93", edgecolor=PALETTE[1], linewidth=1.0)
        start = contents.dataset.upright(places)
        arrows = magnification * contents.dataset.upright(vectors)
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
    return drawing, magnification


def _round_down(factor: float) -> float:
    """Return the largest number of the form 1, 2 or 5 times a power of ten that is at most `factor`."""
    power = 10.0 ** math.floor(math.log10(max(factor, 1e-6)))
    return next(step * power for step in (5.0, 2.0, 1.0) if step * power <= factor * (1 + 1e-9))


def _values(contents: DatasetContents) -> dict[str, Any] | None:
    best = contents.best
    if best is None:
        return None
    drawn, magnification = drawn_residuals(contents, best)
    caption = (
        f"The beam simulated with {best.fitted_law.label} (grey), and its residuals: arrows to the measured points, "
        f"magnified {magnification:g} times. The titles give the load and the error of each state."
    )
    return {"best": best, "picture": Picture("residual_arrows", drawn, "residuals as arrows on the beam", caption)}


PANEL = DatasetPanel(
    place=30,
    title="Simulated and measured beam, with magnified residuals",
    template="{{ picture | figure }}",
    values=_values,
)
