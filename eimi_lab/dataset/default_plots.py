"""The plots that a viewer of NeXus files shows for a dataset: tip deflection against field, and the edges.

The attribute `default` names the first plot (https://manual.nexusformat.org/datarules.html, "Find the plottable data").
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
    """Add two plots for viewers to a dataset: the deflection of the tip (shown first), and the edges.

    Parameters
    ----------
    entry
        The HDF5 group that contains the whole dataset.
    process
        The HDF5 group that contains the edges and gets the plots.
    edge_sets
        The edges of each load step.
    """
    _write_tip(process, entry["states/field"][()], edge_sets)
    if "calibration" in entry:
        _write_outline(process, parse(Calibration, get_text(entry["calibration"], "data"), "calibration"), edge_sets)
    process.attrs["default"] = "tip"
    entry.attrs["default"] = process.name.rsplit("/", 1)[-1]


def _write_tip(process: h5py.Group, field_mT: np.ndarray, edge_sets: Sequence[EdgeSet]) -> None:
    """Write the plot of the tip deflection (mm) against the field (mT); NaN for a load step without edges."""
    middles = [edges.middle_mm for edges in edge_sets]
    across = np.array([middle[-1, 1] if len(middle) else np.nan for middle in middles])
    order = np.argsort(field_mT[: len(across)], kind="stable")
    plot = group(process, "tip", "NXdata")
    plot["field"], plot["tip_deflection"] = field_mT[order], across[order]
    _describe(plot, "tip_deflection", "field", "Tip against field")
    plot["field"].attrs.update(units="mT", long_name="field, mT")
    plot["tip_deflection"].attrs.update(units="mm", long_name="tip, across the beam at rest, mm")


def _write_outline(process: h5py.Group, calibration: Calibration, edge_sets: Sequence[EdgeSet]) -> None:
    """Write a plot of the edges of the beam in all load steps: one curve in mm, with NaN between two edges."""
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
