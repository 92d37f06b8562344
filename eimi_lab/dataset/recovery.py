"""A crashed file made whole again: every acknowledged state, in a new file that is closed properly."""

from __future__ import annotations

from pathlib import Path

import h5py

from eimi_lab.dataset.layout import FRAME_COLUMNS, STATE_COLUMNS
from eimi_lab.dataset.reading import Dataset, open_dataset, open_file
from eimi_lab.errors import InputError
from eimi_lab.outputs import whole_file


def recover(crashed: str | Path, path: str | Path, force: bool = False) -> int:
    """Copy what a crashed writer acknowledged to the new file `path`; returns the number of states.

    The copy is read back before it takes its name, frame by frame against their checksums. Raises InputError.
    """
    with whole_file(Path(path), force) as temporary:
        source, finished = open_file(Path(crashed))
        with source, h5py.File(temporary, "w", libver="latest") as copy:
            dataset = Dataset(Path(crashed), source, finished)
            copy.attrs["default"] = "entry"
            source.copy("entry", copy)
            if dataset.kind == "frames":
                _drop_unacknowledged(copy["entry"], len(dataset.states))
        try:
            return _read_back(temporary)
        except InputError as error:  # the copy is bit for bit the crashed file's, its damage too
            raise InputError(str(error).replace(str(temporary), str(crashed))) from error


def _read_back(path: Path) -> int:
    with open_dataset(path) as recovered:
        if recovered.kind == "frames":
            for state in recovered.states:
                recovered.images(state.index)
        return len(recovered.states)


def _drop_unacknowledged(entry: h5py.Group, states: int) -> None:
    frames = int((entry["data/state"][()] < states).sum())
    for name in STATE_COLUMNS:
        entry["states"][name].resize(states, axis=0)
    for name in ("frames", *FRAME_COLUMNS):
        entry["data"][name].resize(frames, axis=0)
