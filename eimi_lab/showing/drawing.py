"""How every picture of results looks: one style, figures that show themselves in a notebook."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator
from numpy.typing import NDArray

from eimi_lab.showing.palette import IN_ORDER

WIDTH_IN = 7.1  # an A4 page between margins of 15 mm: type is as large in print as it says
STYLE: Any = {
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.labelsize": 9,
    "legend.fontsize": 8,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.titley": 1.0,  # not looked for above what else stands there, which takes as long as all the axes' labels
    "grid.alpha": 0.25,
    "legend.frameon": False,
    "lines.linewidth": 1.3,
    "lines.markersize": 4,
    "svg.hashsalt": "eimi-lab",  # equal figures are equal files
    "path.simplify_threshold": 0.2,
}
styled = matplotlib.rc_context(STYLE)
"""Decorates what draws: artists take their style when they are made."""


class Drawing(Figure):
    """A matplotlib figure as wide as a page that a notebook shows by itself, with pyplot loaded or without."""

    def __init__(self, height_in: float = 3.0, width_in: float = WIDTH_IN) -> None:
        super().__init__(figsize=(width_in, height_in), layout="constrained")

    def _repr_png_(self) -> bytes:
        return saved(self, "png", dpi=120)


def saved(figure: Figure, format: str, **how: Any) -> bytes:
    """A figure as the bytes of a file, without the time at which it was made."""
    buffer = io.BytesIO()
    undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(format)
    with matplotlib.rc_context(STYLE):
        layout = figure.get_layout_engine()
        if layout is not None:  # once for all files of a figure, and without the draw that savefig would spend on it
            layout.execute(figure)
            figure.set_layout_engine(None)  # "none" leaves a placeholder, for whose sake savefig draws twice
        figure.savefig(buffer, format=format, metadata=undated, **how)
    return buffer.getvalue()


def label(axes: Axes, x: str, y: str) -> None:
    """Names on the axes."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)


def by_field(field_mT: Sequence[float], numbers: Sequence[int]) -> tuple[NDArray[np.float64], str]:
    """Return what states are drawn against, and its name: their field or, where that does not change, their number."""
    fields = np.array(field_mT, dtype=np.float64)
    return (
        (fields, "field, mT") if len(fields) and np.ptp(fields) > 0 else (np.array(numbers, dtype=np.float64), "state")
    )


def colours_in_order(values: NDArray[np.float64]) -> ScalarMappable:
    """Return the colours of an ordered quantity between its least and its largest value."""
    ends = (values.min(), values.max()) if len(values) else (0.0, 1.0)
    return ScalarMappable(Normalize(ends[0], max(ends[1], ends[0] + 1e-9)), matplotlib.colormaps[IN_ORDER])


def plain_logarithm(axes: Axes) -> None:
    """Numbers in full on a logarithmic y axis, and no more of them than can be told apart."""
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_locator(NullLocator())
