"""Read the frames of the load steps from a dataset, and find damaged frames."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from eimi_lab.dataset.layout import to_stored
from eimi_lab.process.errors import InputError
from eimi_lab.process.limits import refuse_unpacked


def images_of_state(path: Path, entry: h5py.Group, state_index: int, most: int | None) -> NDArray[Any]:
    """Return the n frames of a load step, type uint8 or uint16.

    Parameters
    ----------
    path : Path
        The file, for the message of an error.
    entry : h5py.Group
        The HDF5 group that contains the whole dataset.
    state_index : int
        The number of the load step.
    most : int or None
        The largest number of frames; None for all frames.

    Returns
    -------
    ndarray, shape (n, H, W) or (n, H, W, 3: blue, green, red)
        The frames.

    Raises
    ------
    InputError
        If a frame is damaged, or if the frames would not fit into memory.
    """
    rows = np.flatnonzero(entry["data/state"][()] == state_index)[:most]
    frames = entry["data/frames"]
    count = int(rows[-1] + 1 - rows[0]) if len(rows) else 0
    claimed = count * int(np.prod(frames.shape[1:], dtype=object)) * frames.dtype.itemsize
    refuse_unpacked(claimed, f"{path}: according to the file, state {state_index} has {len(rows)} frames, which")
    try:
        images = frames[rows[0] : rows[-1] + 1]
    except OSError as error:
        raise _damaged(path, frames, state_index, rows, error) from error
    return images if images.ndim == 3 else images[..., ::-1]


def each_image_of_state(path: Path, entry: h5py.Group, state_index: int) -> Iterator[NDArray[Any]]:
    """Yield the frames of a load step one after another, shape (H, W) or (H, W, 3: blue, green, red).

    Parameters
    ----------
    path : Path
        The file, for the message of an error.
    entry : h5py.Group
        The HDF5 group that contains the whole dataset.
    state_index : int
        The number of the load step.

    Raises
    ------
    InputError
        If a frame is damaged.
    """
    rows = np.flatnonzero(entry["data/state"][()] == state_index)
    frames = entry["data/frames"]
    for row in rows:
        try:
            image = frames[row]
        except OSError as error:
            raise _damaged(path, frames, state_index, rows, error) from error
        yield to_stored(image)


def _damaged(path: Path, frames: h5py.Dataset, state_index: int, rows: NDArray[np.int64], error: OSError) -> InputError:
    """Return an InputError that lists the damaged frames of a load step, after HDF5 raised ``error``."""
    damaged = ", ".join(str(row - rows[0]) for row in rows.tolist() if not _readable(frames, row))
    return InputError(
        f"{path}: frame {damaged} of the {len(rows)} frames of state {state_index} (counted from 0) "
        f"is damaged ({error}); `eimi recover` makes a copy without damaged frames"
    )


def damaged_frames(frames: h5py.Dataset) -> tuple[int, ...]:
    """Return the row numbers of all damaged frames in an HDF5 array of frames. Every frame is read."""
    return tuple(row for row in range(len(frames)) if not _readable(frames, row))


def _readable(frames: h5py.Dataset, row: int) -> bool:
    try:
        frames[row]
    except OSError:
        return False
    return True
