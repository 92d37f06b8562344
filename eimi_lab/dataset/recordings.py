"""Recordings: series of frames that a run takes in addition to the frames of the load steps.

The groups of the file are: transients (settling, creep), ring_down (free oscillation), release (the same in early
versions) and conditioning (load cycles before the run). A row without a value in the column `time` is incomplete.
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

# In HDF5's single-writer-multiple-reader mode, an open file gets no new groups. Each recording therefore has only one
# group, created together with the file. The column `time` is written last: after a crash, a row without a time is
# incomplete.
TRANSIENTS, RELEASE, CONDITIONING, RING_DOWN = "transients", "release", "conditioning", "ring_down"
BELONGS_TO = {TRANSIENTS: "state", RELEASE: "state", CONDITIONING: "cycle", RING_DOWN: "ring_down"}
"""For each recording, the name of the column that gives the state, the cycle or the ring-down of each frame."""

COLUMNS: dict[str, tuple[str, str | None]] = {
    "number": ("i8", None),
    "timestamp": ("f8", "s"),
    "set_current": ("f8", "A"),
    "elapsed": ("f8", "s"),
    "time": ("f8", "s"),
}


@dataclass(frozen=True)
class Moment:
    """A frame of a recording, with the times of the frame and the set-point of the current.

    Parameters
    ----------
    frame
        The frame.
    time_s
        Time of the frame on the clock of the run, s.
    elapsed_s
        Time of the frame since the last change of the set-point, s.
    set_A
        The set-point of the current, A.
    """

    frame: Frame
    time_s: float
    elapsed_s: float
    set_A: float


@dataclass(frozen=True)
class Recording:
    """The n frames of a recording, such as the frames while the beam settles, in the order of time.

    Parameters
    ----------
    images
        The frames, shape (n, H, W) or (n, H, W, 3: blue, green, red).
    belongs_to
        (n,) number of the load step, load cycle or free oscillation of each frame.
    time_s, elapsed_s
        (n,) time on the clock of the run, and time since the last change of the set-point, s.
    set_A
        (n,) set-point of the current, A.
    """

    images: NDArray[Any]
    belongs_to: NDArray[np.int64]
    time_s: NDArray[np.float64]
    elapsed_s: NDArray[np.float64]
    set_A: NDArray[np.float64]


def planned(protocol: Protocol | None) -> tuple[str, ...]:
    """Return the names of the recordings (frames in addition to those of the load steps) for which a protocol asks."""
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
    """Create the HDF5 groups of empty recordings (frames in addition to those of the load steps) in a new dataset.

    Parameters
    ----------
    entry
        The HDF5 group that contains the whole dataset.
    names
        Names of the recordings.
    image
        An example frame, which has the shape and the type of all frames.
    """
    for name in names:
        store = group(entry, name, "NXdata")
        store.attrs["signal"] = "frames"
        store.attrs["axes"] = ["time"] + ["."] * image.ndim
        frame_stack(store, "frames", image)
        columns(store, {BELONGS_TO[name]: ("i8", None), **COLUMNS})


# The caller keeps the arrays of `store` open: HDF5 reports no error (such as a full disk) when an array is closed.
def append_moments(
    recording: str,
    store: Mapping[str, h5py.Dataset],
    images: NDArray[Any],
    belongs_to: Sequence[int],
    moments: Sequence[Moment],
    beat: Callable[[], None],
) -> None:
    """Append frames to a recording (frames in addition to those of the load steps). A crash leaves the file readable.

    Parameters
    ----------
    recording
        Name of the recording.
    store
        The HDF5 arrays of the recording, by name.
    images
        The frames, shape (n, H, W) or (n, H, W, 3: red, green, blue).
    belongs_to
        Number of the load step, load cycle or free oscillation of each frame.
    moments
        Times and set-point of each frame.
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
    """Append the rows of a recording (series of frames) for frames whose images are already in the file.

    Parameters
    ----------
    recording
        Name of the recording.
    store
        The columns of the recording in the file, by name.
    belongs_to
        Number of the load step, load cycle or free oscillation of each frame.
    moments
        Times and set-point of each frame.
    """
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
    """Read the frames of a recording (frames in addition to those of the load steps).

    Parameters
    ----------
    entry
        The HDF5 group that contains the whole dataset.
    name
        Name of the recording, such as "ring_down".
    states
        Number of completely stored load steps; frames of later load steps are not read.
    only
        Number of one load step, load cycle or free oscillation; None for all frames.

    Returns
    -------
    Recording or None
        The frames; None if the file does not contain them.

    Raises
    ------
    InputError
        If the frames need more memory than is free. For a damaged file HDF5 may raise other errors.
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
    refuse_unpacked(
        claimed, f"{store.file.filename}: according to the file, {store.name} has {len(rows)} frames, which"
    )
    images = frames[first : rows[-1] + 1][rows - first]
    return Recording(
        images if images.ndim == 3 else images[..., ::-1],
        belongs_to[rows],
        *(store[column][()][rows] for column in ("time", "elapsed", "set_current")),
    )


def complete_rows(entry: h5py.Group, name: str, states: int) -> NDArray[np.int64]:
    """Return the numbers of the rows of a recording (series of frames) that were stored completely before a crash.

    Parameters
    ----------
    entry
        The HDF5 group that contains the whole dataset.
    name
        Name of the recording.
    states
        Number of completely stored load steps; rows of later load steps are left out.
    """
    store = entry[name]
    rows = np.arange(min(len(store[column]) for column in ("frames", BELONGS_TO[name], *COLUMNS)))
    return rows[store["state"][()][rows] < states] if BELONGS_TO[name] == "state" else rows


def keep_rows(entry: h5py.Group, name: str, rows: NDArray[np.int64]) -> None:
    """Remove all rows of a recording (series of frames) except ``rows``, which must be in increasing order.

    ``entry`` is the HDF5 group that contains the whole dataset, and ``name`` is the name of the recording.
    """
    store = entry[name]
    for place, row in enumerate(rows):
        if place != row:
            store["frames"][place] = store["frames"][row]
    store["frames"].resize(len(rows), axis=0)
    for column in (BELONGS_TO[name], *COLUMNS):
        values = store[column][()][rows]
        store[column].resize(len(rows), axis=0)
        store[column][:] = values
