"""Show the first image of each load step with the edges, and the defects that checks found."""

from __future__ import annotations

import textwrap
from typing import Any

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from numpy.typing import NDArray

from eimi_lab.dataset.state import State
from eimi_lab.reporting.contents import DatasetContents
from eimi_lab.reporting.elements import Picture, Table
from eimi_lab.reporting.frames import Crop, crop_of, edges_px, load_words
from eimi_lab.reporting.panel import DatasetPanel
from eimi_lab.showing.drawing import WIDTH_IN, Drawing
from eimi_lab.showing.palette import PALETTE
from eimi_lab.showing.significant import significant
from eimi_lab.vision.flags import Flag

Array = NDArray[np.float64]

_MOST = 48  # thumbnails
_ABREAST = 8
_FEWEST = 4  # columns in the width of a page; fewer thumbnails make a narrower figure
_THUMB_PX = 180
_GAP = 0.06  # between thumbnails, as a fraction of their width
_LINE = 0.17  # height of a line of text, as a fraction of the width of a thumbnail
_FLAG_CHARACTERS = 17


def contact_sheet(contents: DatasetContents, flags: dict[int, list[Flag]]) -> Drawing:
    """Draw small pictures of the load steps of a dataset, in their order."""
    crop = crop_of(contents)
    states = shown_states(contents)
    rows = -(-len(states) // _ABREAST)
    columns = -(-len(states) // rows)
    words = {
        s.index: textwrap.wrap(", ".join(dict.fromkeys(f.name for f in flags[s.index])), _FLAG_CHARACTERS)
        for s in states
    }
    above = _LINE * (1 + 0.8 * max(map(len, words.values())))
    tall = crop.height_over_width + above + _GAP
    width = WIDTH_IN * min(1.0, len(states) / _FEWEST)
    drawing = Drawing(width / columns / (1 + _GAP) * rows * tall, width)
    axes = drawing.subplots()
    edges: list[Array] = []
    left_out = {flagged.state for flagged in contents.evidence.used.left_out}
    for place, state in enumerate(states):
        row, column = divmod(place, columns)
        x, y = column * (1 + _GAP), row * tall
        edges += _thumbnail(axes, contents, state, crop, (x, y + above))
        out = state.index in left_out
        title = f"{state.index}: {load_words(state)}{', left out' if out else ''}"
        axes.text(x, y + 0.02, title, va="top", fontsize=7, fontweight="bold" if out else "normal")
        names = "\n".join(words[state.index])
        axes.text(x, y + _LINE, names, va="top", fontsize=5.5, fontfamily="DejaVu Sans Mono")
    axes.add_collection(LineCollection(edges, colors=PALETTE[1], linewidths=0.7), autolim=False)
    axes.set_xlim(-0.01, columns * (1 + _GAP))
    axes.set_ylim(rows * tall, -0.02)
    axes.set_aspect("equal")
    axes.axis("off")
    return drawing


def shown_states(contents: DatasetContents) -> tuple[State, ...]:
    """Return all load steps of a dataset or, if there are very many, some evenly spaced load steps."""
    states = contents.dataset.states
    return states[:: -(-len(states) // _MOST)]


def _thumbnail(
    axes: Axes, contents: DatasetContents, state: State, crop: Crop, corner: tuple[float, float]
) -> list[Array]:
    """Draw a small copy of the image of a load step, and return the coordinates of both edges in the drawing.

    `corner` is the position of its upper left corner; its width is 1. Each edge has n points (x, y), shape (n, 2).
    """
    x, y = corner
    size = (_THUMB_PX, max(1, round(_THUMB_PX * crop.height_over_width)))
    image = crop.of(contents.dataset.images(state.index, 1)[0])
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    axes.imshow(small, cmap="gray", vmin=0, vmax=1, extent=(x, x + 1, y + crop.height_over_width, y))
    return [[x, y] + crop.places(side) / (crop.right - crop.left) for side in edges_px(contents, state)]


def flags_of(contents: DatasetContents) -> dict[int, list[Flag]]:
    """Return the flags (defects that checks found) of each load step, by index of the load step."""
    edges = contents.dataset.edges()
    return {s.index: [*s.flags, *(edges[s.index].flags if edges else ())] for s in contents.dataset.states}


def table_of_flags(flags: dict[int, list[Flag]]) -> Table | None:
    """Return a table of the flags (defects that checks found) of a dataset; None without flags."""
    by_name: dict[str, list[tuple[int, Flag]]] = {}
    for index, flags_of_state in flags.items():
        for flag in flags_of_state:
            by_name.setdefault(flag.name, []).append((index, flag))
    rows = []
    for name, cases in by_name.items():
        worst = max((flag for _, flag in cases), key=lambda flag: abs(flag.value - flag.limit))
        states = ", ".join(str(index) for index in dict.fromkeys(index for index, _ in cases))
        rows.append((name, worst.severity, states, significant(worst.value, 3), f"{worst.limit:.3g}", worst.remedy))
    head = ("flag", "severity", "states", "worst value", "limit", "what to do")
    return Table("flags", "Flags of the states.", head, rows) if rows else None


def _values(contents: DatasetContents) -> dict[str, Any] | None:
    if contents.dataset.kind != "frames" or not contents.dataset.states:
        return None
    flags = flags_of(contents)
    shown, total = len(shown_states(contents)), len(contents.dataset.states)
    edges = f"simulated by {contents.best.fitted_law.label}" if contents.best else "as measured"
    words = (
        f"The first frame of {'each state' if shown == total else f'{shown} of {total} states'}, with the edges {edges}"
    )
    words += ", and the names of the flags." if any(flags.values()) else ". No state has a flag."
    picture = Picture("contact_sheet", contact_sheet(contents, flags), "a frame of each state", words, photograph=True)
    return {"picture": picture, "flags": table_of_flags(flags)}


PANEL = DatasetPanel(
    place=10,
    title="Contact sheet",
    template="{{ picture | figure }}{% if flags %}{{ flags | table }}{% endif %}",
    values=_values,
)
