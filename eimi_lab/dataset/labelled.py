"""What was measured, as an xarray.Dataset: every state along one dimension, with its current, field and tip force."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from eimi_lab.errors import InputError
from eimi_lab.tables import installed

if TYPE_CHECKING:  # a dataset labels itself through this module
    from eimi_lab.dataset.reading import Dataset


def labelled(dataset: Dataset) -> Any:
    """xarray.Dataset of edges (state, side, point, axis) or tracked points (state, point, axis), in mm.

    States with fewer points are filled up with NaN. Raises ImportError without xarray, InputError for frames that were
    not segmented.
    """
    xarray = installed("xarray")
    states = dataset.states
    coordinates: dict[str, Any] = {
        "state": [s.index for s in states],
        "field": ("state", [s.field_mT for s in states], {"units": "mT"}),
        "current": ("state", [np.nan if s.current_A is None else s.current_A for s in states], {"units": "A"}),
        "tip_force": ("state", [s.tip_force_N for s in states], {"units": "N"}),
        "flagged": ("state", [bool(s.flags) for s in states]),
        "axis": ["x", "y"],
    }
    mm = {"units": "mm"}
    if dataset.kind == "points":
        tracked = dataset.points()
        if len({p.names for p in tracked}) == 1:
            coordinates["point"] = list(tracked[0].names)
        variables = {
            "rest": (("state", "point", "axis"), _filled([p.rest_mm for p in tracked]), mm),
            "place": (("state", "point", "axis"), _filled([p.points_mm for p in tracked]), mm),
            "sigma": (("state", "point"), _filled([p.sigma_mm for p in tracked]), mm),
        }
    else:
        edges = dataset.edges()
        if edges is None:
            raise InputError(f"{dataset.path}: has no edges yet; `eimi segment` finds them")
        coordinates["side"] = ["left", "right"]
        coordinates["flagged"] = ("state", [bool(s.flags or e.flags) for s, e in zip(states, edges, strict=True)])
        sides = [side for e in edges for side in (e.left, e.right)]
        places, sigma = _filled([s.points_mm for s in sides]), _filled([s.sigma_mm for s in sides])
        variables = {
            "edge": (("state", "side", "point", "axis"), places.reshape(len(edges), 2, -1, 2), mm),
            "sigma": (("state", "side", "point"), sigma.reshape(len(edges), 2, -1), mm),
        }
    return xarray.Dataset(
        variables, coordinates, {"path": str(dataset.path), "specimen": dataset.specimen.specimen.name}
    )


def _filled(arrays: Sequence[Any]) -> Any:
    """Arrays (n_i, ...) as one (len, max n_i, ...), NaN where there is nothing."""
    most = max((len(a) for a in arrays), default=0)
    filled = np.full((len(arrays), most, *np.shape(arrays[0])[1:]), np.nan)
    for row, values in zip(filled, arrays, strict=True):
        row[: len(values)] = values
    return filled
