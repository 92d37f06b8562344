"""Draw figures of a fit for a notebook: stress against strain, residuals, and errors of the states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from numpy.typing import NDArray

from eimi_fitting.laws.law import Law
from eimi_fitting.laws.tensile import engineering_stress
from eimi_lab.showing.drawing import Drawing, by_field, label, styled
from eimi_lab.showing.palette import IN_ORDER, MARKERS, PALETTE

Array = NDArray[np.float64]

_BEYOND = 2.0  # the figure ends at this multiple of the largest strain in the data
_WITHOUT_DATA = 0.1  # the figure ends at this strain if the strains in the data are not determined


@styled
def drawn_law(law: Law, parameters: Array, drawn: Array, max_stretch: float) -> Drawing:
    """Draw engineering stress against strain in uniaxial tension for a law; strains beyond the data are shaded.

    Parameters
    ----------
    law : Law
        Hyperelastic law.
    parameters : ndarray, shape (n,)
        Parameters of the law.
    drawn : ndarray, shape (D, n)
        D random samples of the parameters, for the shaded 95 % interval.
    max_stretch : float
        Largest stretch in the data; 1 if it is not determined.
    """
    reached = max_stretch - 1
    strain = np.linspace(0, _BEYOND * reached or _WITHOUT_DATA, 101)
    drawing = Drawing(3.0, 4.8)
    axes = drawing.subplots()
    axes.axvspan(100 * reached, 100 * strain[-1], color="0.92", zorder=0, label="extrapolated")
    if len(drawn):
        band = np.quantile(engineering_stress(law, drawn, strain), [0.025, 0.975], axis=0)
        axes.fill_between(100 * strain, *(1e-3 * band), color=PALETTE[0], alpha=0.25, linewidth=0, label="95 %")
    axes.plot(100 * strain, 1e-3 * engineering_stress(law, parameters, strain), color=PALETTE[0], label=law.name)
    axes.set_xlim(0, 100 * strain[-1])
    label(axes, "strain in uniaxial tension, %", "engineering stress, kPa")
    axes.legend()
    return drawing


@styled
def drawn_errors(
    states: Sequence[int], field_mT: Sequence[float], error_mm: Sequence[float], deviation_mm: Sequence[float]
) -> Drawing:
    """Draw the error of a fit (mm) in each state against the field (mT), with bars of one standard deviation.

    If the field is constant, the horizontal axis is the index of the state.
    """
    x, words = by_field(field_mT, states)
    drawing = Drawing(3.0, 4.8)
    axes = drawing.subplots()
    error, deviation = 1e3 * np.array(error_mm), 1e3 * np.array(deviation_mm)
    below = np.minimum(deviation, error)
    axes.errorbar(x, error, yerr=[below, deviation], color=PALETTE[0], marker="o", capsize=2)
    axes.set_ylim(bottom=0)
    label(axes, words, "error, µm")
    return drawing


@styled
def drawn_residuals(edges: Sequence[str], field_mT: Array, arc_length_mm: Array, distance_mm: Array) -> Drawing:
    """Draw the distances of measured from simulated points against the arc length of each edge.

    `distance_mm` and `arc_length_mm` have the axes state, edge and point; `field_mT` has the axis state.
    """
    values = field_mT if np.ptp(field_mT) > 0 else np.arange(float(len(field_mT)))
    scale = ScalarMappable(Normalize(values.min(), max(values.max(), values.min() + 1e-9)), colormaps[IN_ORDER])
    drawing = Drawing(4.2)
    grid = drawing.subplots(2, 1, sharex=True, sharey=True)
    for side, (axes, name) in enumerate(zip(grid, edges, strict=True)):
        for k, value in enumerate(values):
            order = np.argsort(arc_length_mm[k, side])
            axes.plot(
                arc_length_mm[k, side, order],
                1e3 * distance_mm[k, side, order],
                color=scale.to_rgba(value),
                linewidth=0.9,
            )
        axes.axhline(0, color="0.2", linewidth=0.6)
        axes.set_title(name, loc="left")
        label(axes, "from the clamp, mm", "measured − simulated, µm")
        axes.label_outer()
    drawing.colorbar(scale, ax=grid, label="field, mT" if np.ptp(field_mT) > 0 else "state", pad=0.01, aspect=30)
    return drawing


@styled
def drawn_errors_of_several(errors: Mapping[str, tuple[Sequence[float], Sequence[float]]]) -> Drawing:
    """Draw the errors of several fits or datasets against the field.

    `errors` holds, by name, the fields (mT) and the errors (mm) of the states.
    """
    drawing = Drawing(3.0, 4.8)
    axes = drawing.subplots()
    for number, (name, (field_mT, error_mm)) in enumerate(errors.items()):
        axes.plot(
            field_mT,
            1e3 * np.array(error_mm),
            label=name,
            color=PALETTE[number % len(PALETTE)],
            marker=MARKERS[number % len(MARKERS)],
        )
    axes.set_ylim(bottom=0)
    label(axes, "field, mT", "error, µm")
    axes.legend()
    return drawing
