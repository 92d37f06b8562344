"""Rebuild damaged tables of a recovered dataset from its other tables, and remove incomplete groups."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from eimi_lab.config.protocol import Protocol
from eimi_lab.config.toml import parse
from eimi_lab.dataset.dark_and_flat import GROUP as CORRECTION
from eimi_lab.dataset.layout import FRAME_COLUMNS, STATE_COLUMNS, append, columns, flags_to_text, get_text
from eimi_lab.dataset.moving.stored_motions import GROUPS as MOTIONS
from eimi_lab.dataset.recordings import BELONGS_TO
from eimi_lab.dataset.sensor_logs import PLACE as SENSORS
from eimi_lab.dataset.steps import RING_DOWN_STEPS, SET_POINTS
from eimi_lab.dataset.stored_edges import GROUP as EDGES
from eimi_lab.dataset.stored_edges import drop_edges
from eimi_lab.dataset.tip_force_angles import NAME as TIP_FORCE_ANGLE
from eimi_lab.process.errors import InputError

HDF5_RAISES = (OSError, RuntimeError, KeyError, ValueError, TypeError)
"""Kinds of errors that h5py raises for damaged files."""
_FROM_FRAMES, _FROM_STATES = "rebuilt from the frames", "rebuilt from the states"
_OPTIONAL = (SET_POINTS, RING_DOWN_STEPS, CORRECTION, EDGES, *MOTIONS.values(), *BELONGS_TO)
"""Groups of `entry` without which a dataset can be used. A group of these of which a part is lost is removed."""


def rebuilt_tables(entry: h5py.Group, lost: Sequence[str], crashed: Path) -> list[str]:
    """Rebuild damaged tables of frames and load steps in a copy of a dataset, and remove incomplete optional groups.

    Parameters
    ----------
    entry
        The HDF5 group of the copy that contains the whole dataset.
    lost
        Places that could not be copied.
    crashed
        The damaged file, for messages.

    Returns
    -------
    list of str
        The places that are lost or rebuilt.

    Raises
    ------
    InputError
        If the tip forces of an imported dataset are lost.
    """
    if f"{entry.name}/states/{TIP_FORCE_ANGLE}" in lost:
        raise _lost_tip_forces(crashed)
    if "frames" not in entry["data"] or "states" not in entry:
        return _without_incomplete(entry, lost)
    rebuilt = _rebuild_states(entry, crashed) | _rebuild_frame_columns(entry)
    left_out = [place for place in lost if place.removeprefix(f"{entry.name}/") not in rebuilt]
    return _without_incomplete(entry, left_out) + [f"entry/{place} ({words})" for place, words in rebuilt.items()]


def _rebuild_states(entry: h5py.Group, crashed: Path) -> dict[str, str]:
    """Restore damaged columns of the table of load steps, and return the source of each column by its place."""
    damaged = [name for name in STATE_COLUMNS if not readable(entry["states"], name)]
    if not damaged:
        return {}
    data = entry["data"]
    indices, first = np.unique(data["state"][()], return_index=True)
    values: dict[str, Any] = {
        "current": lambda: data["set_current"][()][first],
        "field": lambda: data["field"][()][first],
        "tip_force": lambda: np.full(len(indices), _tip_force_N(entry, crashed)),
        "flags": lambda: [flags_to_text(())] * len(indices),
        "index": lambda: indices,
    }
    for name in damaged:
        rows = values[name]()
        if name in entry["states"]:
            del entry["states"][name]
        append(columns(entry["states"], {name: STATE_COLUMNS[name]})[name], rows)
    sources = {"tip_force": "rebuilt from the protocol", "flags": "lost; the states have no flags now"}
    return {f"states/{name}": sources.get(name, _FROM_FRAMES) for name in damaged}


def _tip_force_N(entry: h5py.Group, crashed: Path) -> float:
    """Return the force at the tip of the beam during a run, N. Raises InputError for a dataset without a protocol."""
    if "protocol" not in entry:
        raise _lost_tip_forces(crashed)
    return parse(Protocol, get_text(entry["protocol"], "data"), f"{crashed}: protocol").tip_force_N


def _lost_tip_forces(crashed: Path) -> InputError:
    return InputError(f"{crashed}: the tip forces of its states are damaged; repeat the import")


def _rebuild_frame_columns(entry: h5py.Group) -> dict[str, str]:
    """Restore damaged columns of the table of frames, and return the source of each column by its place.

    A measured value or a time becomes NaN, and a number of a frame becomes -1.
    """
    data, states = entry["data"], entry["states"]
    damaged = [name for name in FRAME_COLUMNS if name != "state" and not readable(data, name)]
    sources = {}
    of_state = data["state"][()]
    for name in damaged:
        rows = np.full(len(of_state), -1.0 if name == "number" else np.nan)
        of_states = {"set_current": "current", "field": "field"}.get(name)
        if of_states:
            stored = of_state < len(states[of_states])
            rows[stored] = states[of_states][()][of_state[stored]]
        if name in data:
            del data[name]
        append(columns(data, {name: FRAME_COLUMNS[name]})[name], rows)
        sources[f"data/{name}"] = _FROM_STATES if of_states else "lost; its values are unknown now"
    return sources | _link_supply(entry)


def _link_supply(entry: h5py.Group) -> dict[str, str]:
    """Give restored columns of the table of frames their second names in the logs of the supply."""
    linked = {}
    for name in ("set_current", "measured_current"):
        place = f"instrument/supply/{name}"
        for second, first in (("time", "time"), ("value", name)):
            if place in entry and second not in entry[place]:
                entry[place][second] = entry["data"][first]
                linked[f"{place}/{second}"] = f"linked to data/{first}"
    return linked


def _without_incomplete(entry: h5py.Group, lost: Sequence[str]) -> list[str]:
    """Remove every optional group with a damaged part, and return the names of the removed groups and lost tables."""
    sensors = [f"{SENSORS}/{name}" for name in entry.get(SENSORS, ())]
    left_out: dict[str, None] = {}
    for place in lost:
        inside = place.removeprefix("attributes of ").removeprefix(f"{entry.name}/")
        name = next((name for name in (*_OPTIONAL, *sensors) if f"{inside}/".startswith(f"{name}/")), "")
        if place.startswith("attributes of ") and (name == inside or name not in MOTIONS.values()):
            name = ""  # only a motion has attributes that are read again
        if name == EDGES:
            drop_edges(entry)
        elif name in entry and name:
            del entry[name]
        left_out[f"entry/{name}" if name else place] = None
    return list(left_out)


def readable(parent: h5py.Group | h5py.Dataset, part: str | int) -> bool:
    """Return whether HDF5 can read a column of a table (``part``: its name) or a frame (``part``: its number)."""
    try:
        return len(parent[part][()]) >= 0
    except HDF5_RAISES:
        return False
