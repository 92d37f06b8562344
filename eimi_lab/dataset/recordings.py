"""Frames beside those of the states, in the order in which they were taken, each set an NXdata of its own:

transients      while the beam came to rest, beside the state that it came to
release         after the current went from its last value to zero, as fast as the camera was
conditioning    of the first and the last cycle before the run

HDF5's single-writer-multiple-reader mode lets nobody add a group to a file in use, so that there is one group of each
kind, made with the file, and not one a state. A column tells to which state, or cycle, a frame belongs. The column
`time` is written last: rows beyond its end were never complete.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from eimi_drivers.interfaces import Frame
from eimi_lab.config.protocol import Protocol
from eimi_lab.dataset.layout import append, columns, frame_stack, group

TRANSIENTS, RELEASE, CONDITIONING = "transients", "release", "conditioning"
BELONGS_TO = {TRANSIENTS: "state", RELEASE: "state", CONDITIONING: "cycle"}
"""The column that tells to what a frame belongs."""

MOST_BYTES = 8 << 30
"""Of the frames that are read at once. A few bytes in a file can claim any size."""

COLUMNS: dict[str, tuple[str, str | None]] = {
    "number": ("i8", None),
    "timestamp": ("f8", "s"),
    "set_current": ("f8", "A"),
    "elapsed": ("f8", "s"),
    "time": ("f8", "s"),
}


@dataclass(frozen=True)
class Moment:
    """A frame with the time on the run's clock (s), the seconds since the set-point last changed, and that (A)."""

    frame: Frame
    time_s: float
    elapsed_s: float
    set_A: float


@dataclass(frozen=True)
class Recording:
    """Frames (n, H, W), or (n, H, W, 3: blue, green, red), in the order taken; of each, (n,), as `Moment` has it.

    belongs_to: the state or the cycle.
    """

    images: NDArray[Any]
    belongs_to: NDArray[np.int64]
    time_s: NDArray[np.float64]
    elapsed_s: NDArray[np.float64]
    set_A: NDArray[np.float64]


def planned(protocol: Protocol | None) -> tuple[str, ...]:
    """The recordings that a run makes; none for what is imported."""
    if protocol is None:
        return ()
    wanted = {
        TRANSIENTS: protocol.transients.frames_per_state > 0,
        RELEASE: protocol.release is not None,
        CONDITIONING: protocol.conditioning is not None,
    }
    return tuple(name for name in BELONGS_TO if wanted[name])


def make_recordings(entry: h5py.Group, names: Sequence[str], image: NDArray[Any]) -> None:
    """Create recordings for frames like `image`, without any."""
    for name in names:
        store = group(entry, name, "NXdata")
        store.attrs["signal"] = "frames"
        store.attrs["axes"] = ["time"] + ["."] * image.ndim
        frame_stack(store, "frames", image)
        columns(store, {BELONGS_TO[name]: ("i8", None), **COLUMNS})


def append_moments(
    recording: str,
    store: Mapping[str, h5py.Dataset],
    images: NDArray[Any],
    belongs_to: Sequence[int],
    moments: Sequence[Moment],
    beat: Callable[[], None],
) -> None:
    """Add frames, as they are stored, at the end of a recording, flushed in an order that a crash cannot harm.

    store: its columns, which somebody keeps open: one that is let go writes what is left of it, and where the disk is
    full nobody hears of that. beat: called after every frame.
    """
    rows: dict[str, Sequence[float]] = {
        BELONGS_TO[recording]: belongs_to,
        "number": [moment.frame.number for moment in moments],
        "timestamp": [moment.frame.timestamp_s for moment in moments],
        "set_current": [moment.set_A for moment in moments],
        "elapsed": [moment.elapsed_s for moment in moments],
        "time": [moment.time_s for moment in moments],
    }
    for image in images:
        append(store["frames"], image[np.newaxis])
        beat()
    store["frames"].flush()
    for column, values in rows.items():
        append(store[column], values)
        store[column].flush()


def read_recording(entry: h5py.Group, name: str, states: int, only: int | None = None) -> Recording | None:
    """What a file has of a recording, with `only` what belongs to that state or cycle; None where it has nothing.

    states: how many are acknowledged; frames of others are not read. Raises ValueError for more frames than a memory
    holds, and whatever HDF5 raises.
    """
    if name not in entry:
        return None
    rows = complete_rows(entry, name, states)
    store = entry[name]
    belongs_to = store[BELONGS_TO[name]][()]
    if only is not None:
        rows = rows[belongs_to[rows] == only]
    if not len(rows):
        return None
    frames, first = store["frames"], rows[0]
    claimed = (rows[-1] + 1 - first) * int(np.prod(frames.shape[1:], dtype=object)) * frames.dtype.itemsize
    if claimed > MOST_BYTES:
        raise ValueError(f"{store.name} claims {len(rows)} frames, more than could be read")
    images = frames[first : rows[-1] + 1][rows - first]
    return Recording(
        images if images.ndim == 3 else images[..., ::-1],
        belongs_to[rows],
        *(store[column][()][rows] for column in ("time", "elapsed", "set_current")),
    )


def complete_rows(entry: h5py.Group, name: str, states: int) -> NDArray[np.int64]:
    """The rows of a recording that were written as a whole, without those of states never acknowledged."""
    store = entry[name]
    rows = np.arange(min(len(store[column]) for column in ("frames", BELONGS_TO[name], *COLUMNS)))
    return rows[store["state"][()][rows] < states] if BELONGS_TO[name] == "state" else rows


def keep_rows(entry: h5py.Group, name: str, rows: NDArray[np.int64]) -> None:
    """Leave only these rows, in increasing order, in a recording."""
    store = entry[name]
    for place, row in enumerate(rows):
        if place != row:
            store["frames"][place] = store["frames"][row]
    store["frames"].resize(len(rows), axis=0)
    for column in (BELONGS_TO[name], *COLUMNS):
        values = store[column][()][rows]
        store[column].resize(len(rows), axis=0)
        store[column][:] = values
