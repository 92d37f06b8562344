"""The `default` attributes of a dataset lead a viewer of NeXus files to the right first plot."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from eimi_lab.dataset.reading import open_dataset
from eimi_lab.dataset.stored_edges import write_edges
from eimi_lab.vision.edges.edge_set import EdgePoints, EdgeSet


def default_plot(path: Path) -> tuple[str, dict[str, Any]]:
    # Return the name and the contents of the NXdata group to which the `default` attributes lead.
    with h5py.File(path, "r") as file:
        group = file
        while "default" in group.attrs:
            group = group[group.attrs["default"]]
        assert group.attrs["NX_class"] == "NXdata"
        return group.name, {name: item[()] for name, item in group.items() if isinstance(item, h5py.Dataset)}


def put_edges(path: Path) -> None:
    # Store edges of a beam of 10 mm in all states but the last; the tip moves 1 mm to the right in each state.
    along = np.linspace(0.5, 10, 20)
    with open_dataset(path) as dataset:
        states = len(dataset.states)
    sets = []
    for state in range(states - 1):
        across = state * along / 10
        left, right = (EdgePoints(np.column_stack([along, across + y]), np.full(20, 0.01)) for y in (-1, 1))
        sets.append(EdgeSet(left, right, (), np.full((4, 2), np.nan)))
    nothing = EdgePoints(np.zeros((0, 2)), np.zeros(0))
    write_edges(path, [*sets, EdgeSet(nothing, nothing, (), np.full((4, 2), np.nan))])


def test_the_first_plot_shows_frames_or_if_there_are_edges_the_tip(setup: Any) -> None:
    setup.run()
    assert default_plot(setup.path)[0] == "/entry/data"
    put_edges(setup.path)
    name, shown = default_plot(setup.path)
    assert name == "/entry/segmentation/tip"
    assert np.allclose(shown["field"], [0.0, 0.47, 0.94, 1.41])
    assert np.allclose(shown["tip_deflection"], [0.0, 1.0, 2.0, np.nan], atol=0.1, equal_nan=True)


def test_the_plotted_beam_hangs_down_and_bends_to_the_right_as_in_the_picture(setup: Any) -> None:
    setup.run()
    put_edges(setup.path)
    with h5py.File(setup.path, "r") as file:
        outline = file["entry/segmentation/outline"]
        assert (outline.attrs["NX_class"], outline.attrs["signal"], list(outline.attrs["axes"])) == (
            *("NXdata", "up"),
            ["right"],
        )
        up, right = outline["up"][()], outline["right"][()]
        assert outline["up"].attrs["units"] == outline["right"].attrs["units"] == "mm"
    drawn = np.split(np.column_stack([right, up]), np.flatnonzero(np.isnan(up)))
    edges = [edge[1:] for edge in drawn if len(edge) > 1]
    assert len(edges) == 6  # each state with edges has two edges, each as a line of its own
    assert np.allclose(edges[4][[0, -1]], [[0.1 - 1, -0.5], [2 - 1, -10]])
    with open_dataset(setup.path) as dataset:
        assert np.allclose(dataset.upright([10.0, 2.0]), [2.0, -10.0])
        assert dataset.plot()._repr_png_().startswith(b"\x89PNG")
