"""Check that a dataset does not refer to other files, and that each of its arrays would fit into memory."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from eimi_lab.dataset.moving.stored_motions import GROUPS as MOTIONS
from eimi_lab.dataset.recordings import BELONGS_TO
from eimi_lab.dataset.sensor_logs import PLACE as SENSORS
from eimi_lab.dataset.steps import RING_DOWN_STEPS, SET_POINTS
from eimi_lab.process.errors import InputError
from eimi_lab.process.limits import refuse_unpacked

MOST_BYTES = 1 << 30
"""Largest size of a table or of a single frame in bytes."""

FORMER = "former"
"""Name of the group with the specimens and calibrations that were replaced after the run."""

READ = (
    *("entry/specimen", "entry/calibration", "entry/protocol", "entry/rig", "entry/truth", "entry/start_time"),
    *("entry/user_note", "entry/data", "entry/states", "entry/sessions", "entry/correction", "entry/instrument"),
    f"entry/{FORMER}",
    f"entry/{SENSORS}",
    *(f"entry/{name}" for name in (*BELONGS_TO, SET_POINTS, RING_DOWN_STEPS)),
    *(
        "entry/segmentation/projection",
        "entry/segmentation/edges",
        "entry/segmentation/edges/left",
        "entry/segmentation/edges/right",
    ),
)
"""Paths, inside the HDF5 file, of all groups and arrays that the program reads."""


def refuse_links_and_absurd_sizes(path: Path, file: h5py.File) -> None:
    """Raise InputError if a dataset refers to data outside the file, or declares an array that is too large.

    Only the groups and arrays that the program reads are checked. ``path`` is the path of the file, for the message.
    """
    for place in READ:
        _refuse_members(path, file, place)
    for motions in MOTIONS.values():
        _refuse_members(path, file, f"entry/{motions}")
        names = file.get(f"entry/{motions}")
        for name in names if isinstance(names, h5py.Group) else ():
            _refuse_members(path, file, f"entry/{motions}/{name}")
    sensors = file.get(f"entry/{SENSORS}")
    for name in sensors if isinstance(sensors, h5py.Group) else ():
        _refuse_members(path, file, f"entry/{SENSORS}/{name}")
        _refuse_members(path, file, f"entry/{SENSORS}/{name}/stated")
        _refuse_members(path, file, f"entry/{SENSORS}/{name}/value_log")


def _refuse_members(path: Path, file: h5py.File, place: str) -> None:
    parent: Any = file
    for name in place.split("/"):
        if not isinstance(parent, h5py.Group) or name not in parent:
            return
        parent = _member(path, parent, name)
    names = list(parent) if isinstance(parent, h5py.Group) else []
    for item in [_member(path, parent, name) for name in names] or [parent]:
        _refuse_storage(path, item)


def _member(path: Path, parent: h5py.Group, name: str) -> Any:
    """Return a member of an HDF5 group. Raises InputError if its name is a soft or external link."""
    if not isinstance(parent.get(name, getlink=True), h5py.HardLink):
        place = f"{parent.name}/{name}".lstrip("/")
        raise InputError(
            f"{path}: {place} is a link to another place in this file or in another file; a dataset should contain all "
            "of its data itself"
        )
    return parent[name]


def _refuse_storage(path: Path, item: Any) -> None:
    if not isinstance(item, h5py.Dataset):
        return
    if item.external or item.is_virtual:
        raise InputError(
            f"{path}: {item.name} is kept in another file; a dataset should contain all of its data itself"
        )
    if item.name == "/entry/start_time" and item.dtype.hasobject:
        return  # `get_start` reads the copy of fixed length instead
    if item.dtype.hasobject or item.dtype.kind not in "iufS":
        raise InputError(
            f"{path}: {item.name} is of type {item.dtype}; it should have numbers or texts of fixed length"
        )
    row = item.nbytes if item.ndim < 3 else int(np.prod(item.shape[1:], dtype=object)) * item.dtype.itemsize
    if row > MOST_BYTES or item.ndim > 4:
        raise InputError(
            f"{path}: {item.name} has the size {item.shape} according to the file, which is more than the program "
            "reads; the file is damaged, or is not a dataset"
        )
    refuse_unpacked(row, f"{path}: {item.name} of {item.shape}")
