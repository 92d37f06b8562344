"""A figure is turned into the bytes of image files (SVG, PNG); each file is drawn once."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

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
