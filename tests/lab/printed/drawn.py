"""Print the labels of a figure, and the values of its marks in the units of the axes, as text."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import Collection
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch, Rectangle
from matplotlib.text import Text


def printed_figure(figure: Figure) -> str:
    # Return the labels of a figure and the coordinates of its marks, one per line.
    parts = [*figure.texts, *(text for legend in figure.legends for text in legend.get_texts())]
    lines = [text.get_text() for text in parts]
    for axes in figure.axes:
        lines += _texts(axes)
        lines += _marks(axes)
    return "\n".join(line for line in lines if line.strip())


def _texts(axes: Axes) -> Iterator[str]:
    yield from (axes.get_title(loc) for loc in ("left", "center", "right"))
    yield from (axes.get_xlabel(), axes.get_ylabel())
    yield from (text.get_text() for text in axes.texts if isinstance(text, Text))
    legend = axes.get_legend()
    yield from (text.get_text() for text in legend.get_texts()) if legend else ()


def _marks(axes: Axes) -> Iterator[str]:
    x_unit, y_unit = (words.rpartition(", ")[2].split("\n")[0] for words in (axes.get_xlabel(), axes.get_ylabel()))
    for mark in axes.get_children():
        if isinstance(mark, Line2D) and mark.get_transform() == axes.transData:
            places = np.column_stack([np.asarray(data, dtype=float) for data in mark.get_data()])
        elif isinstance(mark, Rectangle) and mark is not axes.patch:
            places = np.array([[mark.get_x() + mark.get_width(), mark.get_y() + mark.get_height()]])
        elif isinstance(mark, PathPatch):
            places = np.asarray(mark.get_path().vertices)
        elif isinstance(mark, Collection) and len(mark.get_paths()):
            places = np.concatenate([np.asarray(path.vertices) for path in mark.get_paths()])
        elif isinstance(mark, AxesImage):
            yield " ".join(f"{value:.6g}" for value in np.ravel(mark.get_array()))
            continue
        else:
            continue
        yield "; ".join(f"{x:.6g} {x_unit}, {y:.6g} {y_unit}" for x, y in places)
