"""Show the residuals of the best fit (distances of measured from simulated points) along the edges."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from eimi_fitting.inference.evidence.measurements import EdgeObservation
from eimi_lab.fits.simulated_fit import Prediction
from eimi_lab.reporting.contents import DatasetContents
from eimi_lab.reporting.elements import Picture
from eimi_lab.reporting.panel import DatasetPanel
from eimi_lab.reporting.residual_noise import residual_noise
from eimi_lab.reporting.shown import ShownFit
from eimi_lab.showing.drawing import Drawing, by_field, colours_in_order, label

Array = NDArray[np.float64]

_AT_THE_MAGNET = (
    "At the face of the magnet a narrow peak of a few µm may grow with the load. This peak may come from the corner "
    "between soft beam and rigid magnet, and not from the material. The edge turns there within less than a pixel, and "
    "the blur of the image and the mesh smooth the corner differently."
)


def along_beam_mm(edge_mm: Array, points_mm: Array, length_mm: float, rigid_mm: float) -> Array:
    """Return where m measured points of the bent beam are on the straight beam: their distances from the clamp.

    Parameters
    ----------
    edge_mm : ndarray, shape (n, 2)
        x and y of n points of the simulated edge, from clamp to tip.
    points_mm : ndarray, shape (m, 2)
        x and y of the measured points.
    length_mm : float
        Length of the straight beam.
    rigid_mm : float
        Length of the rigid part at the tip.

    Returns
    -------
    ndarray, shape (m,)
        Distances from the clamp, mm.
    """
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(edge_mm, axis=0), axis=1))])
    bent = lengths[((points_mm[:, None] - edge_mm) ** 2).sum(axis=-1).argmin(axis=1)]
    soft_mm, from_tip = length_mm - rigid_mm, lengths[-1] - bent
    stretched = bent * soft_mm / max(lengths[-1] - rigid_mm, 1e-9)
    # The soft part is assumed to be stretched uniformly; the rigid part keeps its length.
    return np.asarray(np.where(from_tip < rigid_mm, length_mm - from_tip, stretched))


def drawn_along_beam(contents: DatasetContents, simulated: Prediction[ShownFit]) -> Drawing:
    """Draw the distances of measured from simulated points along both edges; colours show the magnetic fields."""
    observed = simulated.evidence.experiment.observed
    if not isinstance(observed, EdgeObservation):
        raise ValueError("tracked points have no edges")
    states = simulated.evidence.states
    values, words = by_field([state.field_mT for state in states], [state.index for state in states])
    length_mm, rigid_mm = contents.dataset.specimen.specimen.length_mm, rigid_tip_mm(contents)
    scale = colours_in_order(values)
    drawing = Drawing(3.0)
    grid = drawing.subplots(2, 1, sharex=True, sharey=True)
    for side, (axes, name) in enumerate(zip(grid, ("left edge", "right edge"), strict=True)):
        _shade_magnet(axes, contents)
        for k, value in enumerate(values):
            row = simulated.residuals_mm[k, side]
            used = np.isfinite(row)
            at = along_beam_mm(simulated.edges_mm[k, side], observed.points_mm[k, side, used], length_mm, rigid_mm)
            axes.plot(at, 1e3 * row[used], color=scale.to_rgba(value), linewidth=0.9)
        axes.axhline(0, color="0.2", linewidth=0.6)
        axes.set_title(name, loc="left")
        label(axes, "from the clamp along the beam at rest, mm", "")
        axes.label_outer()
    drawing.supylabel("measured − simulated, µm", fontsize=9)
    drawing.colorbar(scale, ax=grid, label=words, pad=0.01, aspect=30)
    return drawing


def rigid_tip_mm(contents: DatasetContents) -> float:
    """Return the length (mm) of the rigid part at the tip: the magnet and the part of the beam beyond the magnet."""
    magnet = contents.dataset.specimen.magnet
    return magnet.length_mm + magnet.tip_offset_mm if magnet else 0.0


def _shade_magnet(axes: Axes, contents: DatasetContents) -> None:
    file = contents.dataset.specimen
    if file.magnet is None:
        return
    end = file.specimen.length_mm - file.magnet.tip_offset_mm
    axes.axvspan(end - file.magnet.length_mm, end, color="0.9", zorder=0)
    axes.annotate(
        "magnet",
        (end - 0.5 * file.magnet.length_mm, 0.98),
        xycoords=("data", "axes fraction"),
        ha="center",
        va="top",
        fontsize=7.5,
        color="0.3",
    )


def _values(contents: DatasetContents) -> dict[str, Any] | None:
    best = contents.best
    if contents.dataset.kind != "frames" or best is None:
        return None
    caption = f"Residuals of {best.fitted_law.label} along both edges, with a line for each state."
    noise = residual_noise(best)
    if contents.dataset.specimen.magnet is not None:
        caption += " " + _AT_THE_MAGNET
    return {
        "best": best,
        "noise": noise,
        "picture": Picture(
            "residual_along_beam", drawn_along_beam(contents, best), "residuals along the edges", caption
        ),
    }


PANEL = DatasetPanel(
    place=40,
    title="Residuals of {{ best.fitted_law.label }}",
    template="""
{{ picture | figure }}
{% if noise %}<p><b>Do the residuals look like noise?</b> {{ noise.answer }}. {{ noise.words }}</p>{% endif %}
""",
    values=_values,
)
