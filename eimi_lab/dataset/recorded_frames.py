"""Frames of a free oscillation or of creep, read from the file one at a time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from eimi_lab.dataset.layout import to_stored
from eimi_lab.dataset.recordings import BELONGS_TO, RELEASE, RING_DOWN, TRANSIENTS, complete_rows
from eimi_lab.dataset.steps import SET_POINTS, RingDownStep, read_steps


class RecordedFrames:
    """The n frames of one free oscillation, or of the creep in one load step, in the order of time.

    Parameters
    ----------
    store : h5py.Group
        The group of the file that contains the frames.
    rows : ndarray of int, shape (n,)
        Rows of the n frames in this group.

    Attributes
    ----------
    time_s, elapsed_s, set_A : ndarray, shape (n,)
        Time on the clock of the run (s), time since the last change of the current (s), and set current (A).
    numbers : ndarray of int, shape (n,)
        Numbers that the camera gave to the frames.
    """

    def __init__(self, store: h5py.Group, rows: NDArray[np.int64]) -> None:
        self._frames, self._rows = store["frames"], rows
        self.time_s, self.elapsed_s, self.set_A, self.numbers = (
            store[name][()][rows] for name in ("time", "elapsed", "set_current", "number")
        )

    def __len__(self) -> int:
        return len(self._rows)

    def images(self) -> Iterator[NDArray[Any]]:
        """Yield the frames one at a time, shape (H, W) or (H, W, 3: blue, green, red).

        Raises OSError for a damaged frame.
        """
        for row in self._rows.tolist():
            yield to_stored(self._frames[row])


def recorded_ring_downs(entry: h5py.Group, states: int) -> tuple[tuple[RingDownStep, RecordedFrames], ...]:
    """Return the change of the current and the frames of each recorded free oscillation; empty if there are none.

    Parameters
    ----------
    entry : h5py.Group
        The HDF5 group that contains the whole dataset.
    states : int
        Number of completely stored load steps.
    """
    if RELEASE in entry:
        rows = complete_rows(entry, RELEASE, states)
        if not len(rows):
            return ()
        frames = RecordedFrames(entry[RELEASE], rows)
        from_A = float(entry["states/current"][states - 1])
        period_s = float(np.median(np.diff(frames.elapsed_s))) if len(frames) > 1 else 0.0
        lost = int(np.maximum(np.diff(frames.numbers) - 1, 0).sum())
        begun_s = float(frames.time_s[0] - frames.elapsed_s[0])
        rate_Hz = 1.0 / period_s if period_s else 0.0
        return ((RingDownStep(0, from_A, 0.0, begun_s, period_s, len(frames), lost, rate_Hz), frames),)
    if RING_DOWN not in entry:
        return ()
    rows = complete_rows(entry, RING_DOWN, states)
    of_row = entry[RING_DOWN][BELONGS_TO[RING_DOWN]][()][rows]
    return tuple((step, RecordedFrames(entry[RING_DOWN], rows[of_row == step.ring_down])) for step in read_steps(entry))


def creep_frames(entry: h5py.Group, states: int, state: int) -> RecordedFrames | None:
    """Return the frames that record creep: from the change of the current to the end of one load step.

    Parameters
    ----------
    entry : h5py.Group
        The HDF5 group that contains the whole dataset.
    states, state : int
        Number of completely stored load steps, and the number of this load step, from 0.

    Returns
    -------
    RecordedFrames or None
        The frames; None if the run stored no set-points or no such frames.
    """
    if TRANSIENTS not in entry or SET_POINTS not in entry:
        return None
    rows = complete_rows(entry, TRANSIENTS, states)
    rows = rows[entry[TRANSIENTS][BELONGS_TO[TRANSIENTS]][()][rows] == state]
    return RecordedFrames(entry[TRANSIENTS], rows) if len(rows) else None
