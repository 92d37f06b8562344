"""Describe the sentences, tables and figures of a panel (a part of a report) as lines of text."""

# Positions that matplotlib computes from the size of texts are left out.

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import Collection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.spines import Spine
from matplotlib.text import Text

from eimi_lab.reporting.elements import Cell, Picture, Table
from eimi_lab.reporting.findings import Finding, Verdict

MOST = 12
"""Largest number of points of a line that is described; of a longer line, so many points are chosen."""

PARTS = (Picture, Table, Cell, Finding, Verdict)
"""Parts of a report whose fields are described. Of any other object, only the type is described."""

_NUMBER = re.compile(r"[-−+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def described(value: Any, name: str = "") -> Iterator[str]:
    # Yield the texts, numbers and graphical marks of a part of a report, one in a line, for a comparison.
    if isinstance(value, Figure):
        yield from figure(value, name)
    elif isinstance(value, str | int | float | datetime) or value is None:
        yield f"{name}: {value}"
    elif isinstance(value, Mapping):
        for key, part in value.items():
            yield from described(part, f"{name}.{key}")
    elif is_dataclass(value) and isinstance(value, PARTS):
        for part in fields(value):
            yield from described(getattr(value, part.name), f"{name}.{part.name}")
    elif isinstance(value, list | tuple):
        for number, part in enumerate(value):
            yield from described(part, f"{name}.{number}")
    else:
        yield f"{name}: {value.name if isinstance(value, Path) else type(value).__name__}"


def numbers(values: Iterable[float]) -> str:
    # Return some of the numbers as text, the first and the last among them.
    every = np.asarray(list(values), dtype=float)
    chosen = (
        every[np.unique(np.linspace(0, len(every) - 1, min(MOST, len(every))).astype(int))] if len(every) else every
    )
    return f"{len(every)} numbers: " + " ".join(f"{value:.4g}" for value in chosen)


def figure(drawing: Figure, name: str) -> Iterator[str]:
    yield f"{name}: size {numbers(drawing.get_size_inches())} in"
    for text in drawing.texts:
        yield f"{name}: {_text(text)}"
    for legend in drawing.legends:
        yield f"{name}: legend {[text.get_text() for text in legend.get_texts()]} {legend._ncols}"
    for number, axes in enumerate(drawing.axes):
        yield from _axes(axes, f"{name} axes {number}")


def _axes(axes: Axes, name: str) -> Iterator[str]:
    place = axes.get_subplotspec()
    where = (place.rowspan.start, place.rowspan.stop, place.colspan.start, place.colspan.stop) if place else ()
    shared = [len(group.get_siblings(axes)) for group in (axes.get_shared_x_axes(), axes.get_shared_y_axes())]
    spines = [side for side, spine in axes.spines.items() if spine.get_visible()]
    yield f"{name}: visible {axes.axison} at {where}, shared {shared}, spines {spines}, aspect {axes.get_aspect()}"
    yield f"{name}: titles {[axes.get_title(loc) for loc in ('left', 'center', 'right')]}"
    for letter, axis in (("x", axes.xaxis), ("y", axes.yaxis)):
        low, high = axis.get_view_interval()
        labels = [t.get_text() for t in axis.get_ticklabels()] if axes.axison else []
        shown = axis.label.get_visible()
        yield (
            f"{name} {letter}: {axis.label.get_text()!r} {shown}, {axis.get_scale()}, from {low:.4g} to {high:.4g}, "
            f"{len(labels)} ticks {[text for text in labels if not _NUMBER.fullmatch(text)]}"
        )
    legend = axes.get_legend()
    if legend is not None:
        yield f"{name}: legend {[text.get_text() for text in legend.get_texts()]}, {legend._ncols} columns"
    for mark in axes.get_children():
        if mark.get_visible() and (words := _mark(mark, axes)):
            yield f"{name}: {words}, above {mark.get_zorder():g}, clipped {mark.get_clip_on()}"


def _mark(mark: Any, axes: Axes) -> str:
    if isinstance(mark, Line2D):
        x, y = (numbers(np.asarray(data, dtype=float)) for data in mark.get_data())
        style = f"{to_hex(mark.get_color())} {mark.get_linestyle()} {mark.get_linewidth():.3g}"
        point = f"{mark.get_marker()} {mark.get_markersize():.3g} {to_hex(mark.get_markerfacecolor(), True)}"
        return f"line {_name(mark)} {style} {point} {mark.get_alpha()}: x {x}; y {y}"
    if isinstance(mark, AxesImage):
        grey = np.asarray(mark.get_array(), dtype=float)
        ends = f"{mark.get_extent()} {mark.get_clim()} {mark.get_cmap().name} {mark.origin}"
        return f"picture {grey.shape} mean {grey.mean():.3g} spread {grey.std():.3g} {ends}"
    if isinstance(mark, Collection):
        colours = [to_hex(colour, True) for colour in mark.get_facecolor()][:MOST]
        edges = [to_hex(colour, True) for colour in mark.get_edgecolor()][:MOST]
        paths = [np.asarray(path.vertices) for path in mark.get_paths()]
        places = np.concatenate([path for path in paths if len(path)]) if any(map(len, paths)) else np.zeros((0, 2))
        where = f"x {numbers(places[:, 0])}; y {numbers(places[:, 1])}"
        return f"{type(mark).__name__} {_name(mark)} {colours} {edges} {numbers(mark.get_linewidth())}: {where}"
    if isinstance(mark, Patch) and not isinstance(mark, Spine) and mark is not axes.patch:
        places = mark.get_transform().transform(mark.get_path().vertices)
        inside = axes.transData.inverted().transform(places)
        colour = f"{to_hex(mark.get_facecolor(), True)} {to_hex(mark.get_edgecolor(), True)} {mark.get_linewidth():.3g}"
        return f"patch {_name(mark)} {colour}: x {numbers(inside[:, 0])}; y {numbers(inside[:, 1])}"
    if isinstance(mark, Text) and mark.get_text() and mark in axes.texts:
        return _text(mark)
    return ""


def _name(mark: Any) -> str:
    # Return the label of a mark; empty if matplotlib has chosen the label.
    label = str(mark.get_label())
    return "" if label.startswith("_") else label


def _text(text: Text) -> str:
    style = (
        f"{to_hex(text.get_color())} {text.get_fontsize():.3g} {text.get_ha()} {text.get_va()} {text.get_rotation()}"
    )
    return f"text {text.get_text()!r} {style} at {numbers(text.get_position())}"


def differences(
    lines: Iterable[str], expected: Iterable[str], relative: float = 0.02, absolute: float = 2e-3
) -> list[str]:
    # Return the lines that differ from the expected lines in a word, or in a number by more than the tolerances.
    def near(one: str, other: str) -> bool:
        if _NUMBER.sub("#", one) != _NUMBER.sub("#", other):
            return False
        values = ([float(text.replace("−", "-")) for text in _NUMBER.findall(line)] for line in (one, other))
        return np.allclose(*values, rtol=relative, atol=absolute)

    here, there = list(lines), list(expected)
    if len(here) != len(there):
        return [f"{len(here)} lines instead of {len(there)}", *sorted(set(here).symmetric_difference(there))]
    return [f"{one}\n    instead of\n{other}" for one, other in zip(here, there, strict=True) if not near(one, other)]
