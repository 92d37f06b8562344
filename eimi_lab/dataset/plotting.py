"""Draw the edges or the tracked points of all load steps of a dataset in one figure."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from eimi_lab.dataset.state import State
from eimi_lab.showing.drawing import Drawing, by_field, colours_in_order, label, styled

Array = NDArray[np.float64]

UPRIGHT = ("to the right", "up")
OF_BEAM = ("along the beam at rest", "across it")


@styled
def drawn_places(
    states: Sequence[State], places: Sequence[Sequence[Array]], axes_names: tuple[str, str], lines: bool
) -> Drawing:
    """Return a figure with the edges or tracked points of all load steps, coloured by the field of the load step.

    If all fields are equal, the colour shows the number of the load step.

    Parameters
    ----------
    states
        The K load steps.
    places
        One or more arrays for each load step, shape (n, 2): two coordinates of n points, mm.
    axes_names
        Names of the two axes.
    lines
        True to draw lines, False to draw points.
    """
    values, name = by_field([state.field_mT for state in states], [state.index for state in states])
    scale = colours_in_order(values)
    drawing = Drawing(4.5)
    axes = drawing.subplots()
    for value, arrays in zip(values, places, strict=True):
        for points in arrays:
            axes.plot(*points.T, "-" if lines else "o", color=scale.to_rgba(value), markersize=3)
    axes.set_aspect("equal", adjustable="datalim")
    label(axes, *(f"{name}, mm" for name in axes_names))
    drawing.colorbar(scale, ax=axes, label=name)
    return drawing
