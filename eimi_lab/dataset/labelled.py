"""Convert edges or tracked points, with the loads of each load step, into an xarray.Dataset."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from eimi_lab.dataset.points import TrackedPoints
from eimi_lab.dataset.state import State
from eimi_lab.showing.tables import installed
from eimi_lab.vision.edges.edge_set import EdgeSet

_MM = {"units": "mm"}


def labelled_points(states: Sequence[State], tracked: Sequence[TrackedPoints], attributes: Mapping[str, str]) -> Any:
    """Return the tracked points of all load steps as an xarray.Dataset.

    The dimensions are state (load step), point and axis (x, y). The variables, in mm, are the positions ``rest`` in the
    unloaded beam, the positions ``place`` in each load step, and the standard deviations ``sigma``. The coordinates
    are the loads and the defects (flags).

    Parameters
    ----------
    states, tracked
        Loads and tracked points of each load step. Missing points become NaN.
    attributes
        Attributes of the xarray.Dataset.

    Raises
    ------
    ImportError
        If xarray is not installed.
    """
    coordinates = _coordinates(states)
    if len({p.names for p in tracked}) == 1:
        coordinates["point"] = list(tracked[0].names)
    variables = {
        "rest": (("state", "point", "axis"), _filled([p.rest_mm for p in tracked]), _MM),
        "place": (("state", "point", "axis"), _filled([p.points_mm for p in tracked]), _MM),
        "sigma": (("state", "point"), _filled([p.sigma_mm for p in tracked]), _MM),
    }
    return installed("xarray").Dataset(variables, coordinates, attributes)


def labelled_edges(states: Sequence[State], edges: Sequence[EdgeSet], attributes: Mapping[str, str]) -> Any:
    """Return the edges of the beam in all load steps as an xarray.Dataset.

    The dimensions are state (load step), side (left or right), point and axis (x, y). The variables are the points
    ``edge`` and their standard deviations ``sigma``, in mm. The coordinates are the loads and the defects (flags).

    Parameters
    ----------
    states, edges
        Loads and edges of each load step. Missing points become NaN.
    attributes
        Attributes of the xarray.Dataset.

    Raises
    ------
    ImportError
        If xarray is not installed.
    """
    coordinates = _coordinates(states)
    coordinates["side"] = ["left", "right"]
    coordinates["flagged"] = ("state", [bool(s.flags or e.flags) for s, e in zip(states, edges, strict=True)])
    sides = [side for e in edges for side in (e.left, e.right)]
    places, sigma = _filled([s.points_mm for s in sides]), _filled([s.sigma_mm for s in sides])
    variables = {
        "edge": (("state", "side", "point", "axis"), places.reshape(len(edges), 2, -1, 2), _MM),
        "sigma": (("state", "side", "point"), sigma.reshape(len(edges), 2, -1), _MM),
    }
    return installed("xarray").Dataset(variables, coordinates, attributes)


def _coordinates(states: Sequence[State]) -> dict[str, Any]:
    return {
        "state": [s.index for s in states],
        "field": ("state", [s.field_mT for s in states], {"units": "mT"}),
        "current": ("state", [np.nan if s.current_A is None else s.current_A for s in states], {"units": "A"}),
        "tip_force": ("state", [s.tip_force_N for s in states], {"units": "N"}),
        "flagged": ("state", [bool(s.flags) for s in states]),
        "axis": ["x", "y"],
    }


def _filled(arrays: Sequence[Any]) -> Any:
    """Return m arrays of up to n rows as one array of shape (m, n, ...), with NaN for missing rows."""
    longest = max((len(a) for a in arrays), default=0)
    filled = np.full((len(arrays), longest, *np.shape(arrays[0])[1:]), np.nan)
    for row, values in zip(filled, arrays, strict=True):
        row[: len(values)] = values
    return filled
