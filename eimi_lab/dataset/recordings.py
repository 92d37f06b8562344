"""Frames that are taken between the states, in the order of time.

Each of these recordings is an NXdata in the file:

    transients      frames while the beam settles at a state, or creeps in it
    ring_down       frames after steps of the current to zero, at the full rate of the camera
    release         the ring-down of a run of an earlier version
    conditioning    frames of the first and the last conditioning cycle before the run

HDF5's single-writer-multiple-reader mode does not allow new groups in a file in use. Therefore each recording is one
group that is created with the file, and a column holds the state or the cycle to which a frame belongs. The column
`time` is written last, so rows beyond its end are incomplete.
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
from eimi_lab.dataset.frame_chunk import append_image
from eimi_lab.dataset.layout import append, columns, frame_stack, group
from eimi_lab.process.limits import refuse_unpacked

TRANSIENTS, RELEASE, CONDITIONING, RING_DOWN = "transients", "release", "conditioning", "ring_down"
BELONGS_TO = {TRANSIENTS: "state", RELEASE: "state", CONDITIONING: "cycle", RING_DOWN: "ring_down"}
"""For each recording, the column with the number of the state, the cycle or the ring-down of a frame."""

COLUMNS: dict[str, tuple[str, str | None]] = {
    "number": ("i8", None),
    "timestamp": ("f8", "s"),
    "set_current": ("f8", "A"),
    "elapsed": ("f8", "s"),
    "time": ("f8", "s"),
}


@dataclass(frozen=True)
class Moment:
    """A frame of a recording.

    Parameters
    ----------
    frame
        The frame.
    time_s
        Time on the run's clock.
    elapsed_s
        Time since the set-point last changed.
    set_A
        The set-point of the current.
    """

    frame: Frame
    time_s: float
    elapsed_s: float
    set_A: float


@dataclass(frozen=True)
class Recording:
    """The frames of a recording, in the order in which they were taken.

    Parameters
    ----------
    images
        (n, H, W) or (n, H, W, 3: blue, green, red).
    belongs_to
        (n,) number of the state or the cycle.
    time_s, elapsed_s, set_A
        (n,) times and set-points as in `Moment`.
    """

    images: NDArray[Any]
    belongs_to: NDArray[np.int64]
    time_s: NDArray[np.float64]
    elapsed_s: NDArray[np.float64]
    set_A: NDArray[np.float64]


def planned(protocol: Protocol | None) -> tuple[str, ...]:
    """Return the names of the recordings that a protocol asks for; none for an import, which has no protocol."""
    if protocol is None:
        return ()
    is_planned = {
        TRANSIENTS: protocol.transients.frames_per_state > 0,
        RELEASE: False,
        RING_DOWN: protocol.ring_down is not None,
        CONDITIONING: protocol.conditioning is not None,
    }
    return tuple(name for name in BELONGS_TO if is_planned[name])


def make_recordings(entry: h5py.Group, names: Sequence[str], image: NDArray[Any]) -> None:
    """Create empty recordings for frames with the shape and type of ``image``."""
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
    """Append frames to a recording, flushed in an order that leaves the file readable after a crash.

    Parameters
    ----------
    recording
        Name of the recording.
    store
        Its columns. The caller must keep them open: HDF5 writes the rest of a column when it is closed, and an error
        at that point, as on a full disk, would go unnoticed.
    images
        The frames in the file's order of colours.
    belongs_to, moments
        For each frame, its state or cycle, and its times and set-point.
    beat
        Function that is called after every frame.
    """
    for image in images:
        append_image(store["frames"], image)
        beat()
    store["frames"].flush()
    append_times(recording, store, belongs_to, moments)


def append_times(
    recording: str, store: Mapping[str, h5py.Dataset], belongs_to: Sequence[int], moments: Sequence[Moment]
) -> None:
    """Append the columns of frames that are already in the file; parameters as for `append_moments`."""
    rows: dict[str, Sequence[float]] = {
        BELONGS_TO[recording]: belongs_to,
        "number": [moment.frame.number for moment in moments],
        "timestamp": [moment.frame.timestamp_s for moment in moments],
        "set_current": [moment.set_A for moment in moments],
        "elapsed": [moment.elapsed_s for moment in moments],
        "time": [moment.time_s for moment in moments],
    }
    for column, values in rows.items():
        append(store[column], values)
        store[column].flush()


def read_recording(entry: h5py.Group, name: str, states: int, only: int | None = None) -> Recording | None:
    """Read a recording.

    Parameters
    ----------
    entry
        The group `entry` of the file.
    name
        Name of the recording.
    states
        Number of complete states; frames of later states are not read.
    only
        Read only the frames of this state or cycle.

    Returns
    -------
    Recording or None
        None if the file has no such frames.

    Raises
    ------
    InputError
        If the file claims more frames than the memory could hold. On a damaged file HDF5 may raise other errors.
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
    refuse_unpacked(claimed, f"{store.file.filename}: {store.name} claims {len(rows)} frames, which")
    images = frames[first : rows[-1] + 1][rows - first]
    return Recording(
        images if images.ndim == 3 else images[..., ::-1],
        belongs_to[rows],
        *(store[column][()][rows] for column in ("time", "elapsed", "set_current")),
    )


def complete_rows(entry: h5py.Group, name: str, states: int) -> NDArray[np.int64]:
    """Return the rows of a recording that are complete and do not belong to an incomplete state."""
    store = entry[name]
    rows = np.arange(min(len(store[column]) for column in ("frames", BELONGS_TO[name], *COLUMNS)))
    return rows[store["state"][()][rows] < states] if BELONGS_TO[name] == "state" else rows


def keep_rows(entry: h5py.Group, name: str, rows: NDArray[np.int64]) -> None:
    """Keep these rows of a recording, given in increasing order, and remove all others."""
    store = entry[name]
    for place, row in enumerate(rows):
        if place != row:
            store["frames"][place] = store["frames"][row]
    store["frames"].resize(len(rows), axis=0)
    for column in (BELONGS_TO[name], *COLUMNS):
        values = store[column][()][rows]
        store[column].resize(len(rows), axis=0)
        store[column][:] = values
