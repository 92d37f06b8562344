"""Draw figures of results in one style, show figures in a notebook, and convert figures to files."""

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

WIDTH_IN = 7.1  # an A4 page between margins of 15 mm, so that type in print has its nominal size
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
    "axes.titley": 1.0,  # a fixed position; the search for a free one takes as long as drawing all labels of the axes
    "grid.alpha": 0.25,
    "legend.frameon": False,
    "lines.linewidth": 1.3,
    "lines.markersize": 4,
    "svg.hashsalt": "eimi-lab",  # equal figures give equal files
    "path.simplify_threshold": 0.2,
}
styled = matplotlib.rc_context(STYLE)
"""Decorator for functions that draw. The decorator sets the style of all figures before any part of a figure is
created.
"""


class Drawing(Figure):
    """A matplotlib figure as wide as a page, which a notebook displays."""

    def __init__(self, height_in: float = 3.0, width_in: float = WIDTH_IN) -> None:
        super().__init__(figsize=(width_in, height_in), layout="constrained")

    def _repr_png_(self) -> bytes:
        return saved(self, "png", dpi=120)


def saved(figure: Figure, format: str, **how: Any) -> bytes:
    """Return a figure as the bytes of a file.

    Parameters
    ----------
    figure
        The figure.
    format
        The type of the file, such as ``"png"``, ``"svg"`` or ``"pdf"``.
    **how
        Further arguments of matplotlib's ``savefig``.
    """
    buffer = io.BytesIO()
    undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(format)
    with matplotlib.rc_context(STYLE):
        layout = figure.get_layout_engine()
        if layout is not None:  # computing the layout here, once for all files, is faster than in savefig
            layout.execute(figure)
            figure.set_layout_engine(None)  # with "none" a placeholder would remain, and savefig would draw twice
        figure.savefig(buffer, format=format, metadata=undated, **how)
    return buffer.getvalue()


def label(axes: Axes, x: str, y: str) -> None:
    """Set the labels of the x axis and the y axis."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)


def by_field(field_mT: Sequence[float], numbers: Sequence[int]) -> tuple[NDArray[np.float64], str]:
    """Return the x value of each of K load steps in a figure, shape (K,), and the label of the x axis.

    The x values are the magnetic fields in mT, or the numbers of the load steps if the field is constant.
    """
    fields = np.array(field_mT, dtype=np.float64)
    return (
        (fields, "field, mT") if len(fields) and np.ptp(fields) > 0 else (np.array(numbers, dtype=np.float64), "state")
    )


def colours_in_order(values: NDArray[np.float64]) -> ScalarMappable:
    """Return a map from values to colours, from the smallest to the largest value."""
    ends = (values.min(), values.max()) if len(values) else (0.0, 1.0)
    return ScalarMappable(Normalize(ends[0], max(ends[1], ends[0] + 1e-9)), matplotlib.colormaps[IN_ORDER])


def plain_logarithm(axes: Axes) -> None:
    """Label a logarithmic y axis with plain numbers at 1, 2 and 5 times powers of ten."""
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_locator(NullLocator())
