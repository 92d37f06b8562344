"""A crashed or damaged file made whole again: every acknowledged state, in a new file that is closed properly."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import h5py
import numpy as np

from eimi_lab.dataset.layout import FRAME_COLUMNS, STATE_COLUMNS, flags_from_text, flags_to_text
from eimi_lab.dataset.reading import Dataset, open_dataset, open_file
from eimi_lab.errors import tell
from eimi_lab.outputs import whole_file
from eimi_lab.vision.edge_set import Flag

_REMEDY = "The file was damaged after it was written: measure the state again, and copy datasets to another disk."


def recover(crashed: str | Path, path: str | Path, force: bool = False, say: Callable[[str], None] = tell) -> int:
    """Copy what a crashed writer acknowledged to the new file `path`; returns the number of states.

    The copy is read back before it takes its name, frame by frame against their checksums. Damaged frames are left out
    and their states flagged DROPPED; a state that loses every frame keeps a black one, so that those after it keep
    their numbers. say: gets one line where frames were damaged. Raises InputError.
    """
    with whole_file(Path(path), force) as temporary:
        source, finished = open_file(Path(crashed))
        with source, h5py.File(temporary, "w", libver="latest") as copy:
            dataset = Dataset(Path(crashed), source, finished)
            copy.attrs["default"] = "entry"
            source.copy("entry", copy)
            if dataset.kind == "frames":
                _drop_unacknowledged(copy["entry"], len(dataset.states))
        with open_dataset(temporary) as recovered:
            states = len(recovered.states)
            damaged = recovered.damaged_frames() if recovered.kind == "frames" else ()
        if damaged:
            with h5py.File(temporary, "r+", libver="latest") as copy:
                of_states = _drop_damaged(copy["entry"], damaged)
            say(
                f"{crashed}: damaged frames left out: {len(damaged)}, of state "
                f"{', '.join(map(str, of_states))} (counted from 0), flagged DROPPED"
            )
        return states


def _drop_unacknowledged(entry: h5py.Group, states: int) -> None:
    frames = int((entry["data/state"][()] < states).sum())
    for name in STATE_COLUMNS:
        entry["states"][name].resize(states, axis=0)
    for name in ("frames", *FRAME_COLUMNS):
        entry["data"][name].resize(frames, axis=0)


def _drop_damaged(entry: h5py.Group, damaged: Sequence[int]) -> list[int]:
    """Take rows of frames out and flag their states; returns those."""
    data, flags = entry["data"], entry["states/flags"]
    of_state = data["state"][()]
    sound = np.ones(len(of_state), dtype=bool)
    sound[list(damaged)] = False
    of_states = sorted({int(of_state[row]) for row in damaged})
    for state in of_states:
        rows = np.flatnonzero(of_state == state)
        lost = int((~sound[rows]).sum())
        flags[state] = flags_to_text((*flags_from_text(flags[state]), Flag("DROPPED", lost, 0, _REMEDY)))
        if lost == len(rows):
            data["frames"][rows[0]] = 0
            sound[rows[0]] = True
    kept = np.flatnonzero(sound)
    for place, row in enumerate(kept):
        if place != row:
            data["frames"][place] = data["frames"][row]
    data["frames"].resize(len(kept), axis=0)
    for name in FRAME_COLUMNS:
        column = data[name][()][kept]
        data[name].resize(len(kept), axis=0)
        data[name][:] = column
    return of_states
