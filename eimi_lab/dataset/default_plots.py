"""The plots that a viewer of NeXus files shows when it opens a dataset: the tip against the field, and the edges.

The attribute `default` leads a viewer from the file to the first plot (https://manual.nexusformat.org/datarules.html,
"Find the plottable data"). Each plot is an NXdata with one signal along one axis, which a viewer draws as a curve.
"""

from __future__ import annotations

from collections.abc import Sequence

import h5py
import numpy as np

from eimi_lab.config.calibration import Calibration
from eimi_lab.config.toml import parse
from eimi_lab.dataset.layout import get_text, group, put_text
from eimi_lab.dataset.upright import turn
from eimi_lab.vision.edges.edge_set import EdgeSet


def write_plots(entry: h5py.Group, process: h5py.Group, edge_sets: Sequence[EdgeSet]) -> None:
    """Add the plots `tip` and `outline` to the group of the edges, and make `tip` the default plot of the file."""
    _write_tip(process, entry["states/field"][()], edge_sets)
    if "calibration" in entry:
        _write_outline(process, parse(Calibration, get_text(entry["calibration"], "data"), "calibration"), edge_sets)
    process.attrs["default"] = "tip"
    entry.attrs["default"] = process.name.rsplit("/", 1)[-1]


def _write_tip(process: h5py.Group, field_mT: np.ndarray, edge_sets: Sequence[EdgeSet]) -> None:
    """Write the deflection of the tip, which is the last point of the middle line; NaN for a state without edges."""
    middles = [edges.middle_mm for edges in edge_sets]
    across = np.array([middle[-1, 1] if len(middle) else np.nan for middle in middles])
    order = np.argsort(field_mT[: len(across)], kind="stable")
    plot = group(process, "tip", "NXdata")
    plot["field"], plot["tip_deflection"] = field_mT[order], across[order]
    _describe(plot, "tip_deflection", "field", "Tip against field")
    plot["field"].attrs.update(units="mT", long_name="field, mT")
    plot["tip_deflection"].attrs.update(units="mm", long_name="tip, across the beam at rest, mm")


def _write_outline(process: h5py.Group, calibration: Calibration, edge_sets: Sequence[EdgeSet]) -> None:
    """Write both edges of every state as the camera sees them, with NaN between the edges to separate the curves."""
    gap = np.full((1, 2), np.nan)
    parts = [
        part
        for edges in edge_sets
        for side in (edges.left, edges.right)
        for part in (side.points_mm.reshape(-1, 2), gap)
    ]
    places = np.concatenate([gap, *parts]) @ turn(calibration, None).T
    plot = group(process, "outline", "NXdata")
    plot["right"], plot["up"] = places.T
    _describe(plot, "up", "right", "Edges of all states")
    plot["right"].attrs.update(units="mm", long_name="to the right, mm")
    plot["up"].attrs.update(units="mm", long_name="up, mm")


def _describe(plot: h5py.Group, signal: str, axis: str, title: str) -> None:
    put_text(plot, "title", title)
    plot.attrs.update(signal=signal, axes=[axis])
    plot.attrs[f"{axis}_indices"] = [0]
