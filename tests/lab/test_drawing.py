"""A figure is turned into SVG and PNG files; each file is drawn once."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from eimi_lab.reporting.drawn_panels import _drawn
from eimi_lab.reporting.elements import Picture
from eimi_lab.showing.drawing import Drawing, saved


def test_each_file_of_a_figure_is_drawn_once_and_the_layout_is_computed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn, draw = list[str](), Figure.draw

    def counted(figure: Figure, renderer: object) -> None:
        drawn.append(type(renderer).__name__)
        draw(figure, renderer)

    figure = Drawing()
    axes = figure.subplots()
    axes.plot([1.0, 2.0], [3.0, 4.0])
    axes.set_ylabel("a name that needs room")
    before = axes.get_position().x0
    monkeypatch.setattr(Figure, "draw", counted)
    vectors, pixels = saved(figure, "svg"), saved(figure, "png", dpi=50)
    assert len(drawn) == 2
    assert vectors == saved(figure, "svg")
    assert vectors.startswith(b"<?xml")
    assert pixels.startswith(b"\x89PNG")
    assert not np.isclose(axes.get_position().x0, before)


def test_the_pictures_of_a_panel_are_encoded_when_the_panel_is_drawn() -> None:
    drawing = Drawing(2.0, 3.0)
    drawing.subplots()
    picture = Picture("one", drawing, "alternative", "caption")
    panel: Any = SimpleNamespace(values=lambda contents: {"picture": picture, "title": contents})
    assert "embedded" not in vars(picture)
    assert _drawn(panel, "title") == {"picture": picture, "title": "title"}
    assert vars(picture)["embedded"].startswith("data:image/svg+xml;base64,")
    omitted: Any = SimpleNamespace(values=lambda contents: None)
    assert _drawn(omitted, "title") is None
