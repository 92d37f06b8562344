"""Where a beam was in each state, as a picture for a notebook."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from numpy.typing import NDArray

from eimi_lab.dataset.state import State
from eimi_lab.showing.drawing import Drawing, label, styled
from eimi_lab.showing.palette import IN_ORDER

Array = NDArray[np.float64]

UPRIGHT = ("to the right", "up")
OF_BEAM = ("along the beam at rest", "across it")


@styled
def drawn_places(
    states: Sequence[State], places: Sequence[Sequence[Array]], axes_names: tuple[str, str], lines: bool
) -> Drawing:
    """Lines or points (n, 2) in mm, some for each state, in the colour of the state's field.

    Where all fields are alike, in the colour of the state's number.
    """
    fields = np.array([state.field_mT for state in states])
    by_field = len(fields) > 0 and np.ptp(fields) > 0
    values = fields if by_field else np.array([float(state.index) for state in states])
    ends = (values.min(), values.max()) if len(values) else (0.0, 1.0)
    scale = ScalarMappable(Normalize(ends[0], max(ends[1], ends[0] + 1e-9)), matplotlib.colormaps[IN_ORDER])
    drawing = Drawing(4.5)
    axes = drawing.subplots()
    for value, own in zip(values, places, strict=True):
        for points in own:
            axes.plot(*points.T, "-" if lines else "o", color=scale.to_rgba(value), markersize=3)
    axes.set_aspect("equal", adjustable="datalim")
    label(axes, *(f"{name}, mm" for name in axes_names))
    drawing.colorbar(scale, ax=axes, label="field, mT" if by_field else "state")
    return drawing
