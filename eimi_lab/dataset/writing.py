"""Writing a dataset of frames so that what was acknowledged survives a crash.

HDF5's single-writer-multiple-reader mode orders its writes such that a file is readable at every moment; each state is
flushed dataset by dataset, the table of states last, and synchronised to the disk before `append_state` returns.
The order comes from The HDF Group's user guide to SWMR: create everything first, then switch the mode on.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

import h5py
import numpy as np

from eimi_drivers.interfaces import Frame
from eimi_lab.dataset.grey import grey
from eimi_lab.dataset.layout import (
    FRAME_COLUMNS,
    Header,
    append,
    columns,
    flags_to_text,
    group,
    now,
    put_text,
    write_header,
    write_state_columns,
)
from eimi_lab.outputs import refuse_existing
from eimi_lab.vision.edge_set import Flag

NAN = float("nan")


class DatasetWriter:
    """Appends one state after another to a new file; use as a context manager.

    Needs a local file system: network file systems do not keep the order of writes.
    """

    def __init__(self, path: Path, header: Header, like: Frame, force: bool = False) -> None:
        """Create the file for frames of the size and depth of `like`. Raises InputError where a file exists."""
        refuse_existing(path, force)
        self.path = path
        self._file = h5py.File(path, "w" if force else "x", libver="latest")
        entry = write_header(self._file, header)
        image = grey(like.image)
        height, width = image.shape

        detector = group(entry["instrument"], "detector", "NXdetector")
        self._frames = detector.create_dataset(
            "data",
            shape=(0, height, width),
            maxshape=(None, height, width),
            chunks=(1, height, width),
            dtype=image.dtype,
            compression="gzip",
            compression_opts=1,
            fletcher32=True,
        )
        self._frames.attrs["units"] = "counts"
        put_text(detector, "description", "side camera")

        data = group(entry, "data", "NXdata")
        data.attrs["signal"] = "frames"
        data.attrs["axes"] = ["field", ".", "."]
        data["frames"] = self._frames
        self._columns = columns(data, FRAME_COLUMNS)

        supply = group(entry["instrument"], "supply", "NXcollection")
        for name in ("set_current", "measured_current"):
            log = group(supply, name, "NXlog")
            log["time"] = self._columns["time"]
            log["value"] = self._columns[name]

        self._states = write_state_columns(entry, "frames")
        self._end_time = entry["end_time"]
        self._file.swmr_mode = True
        self._synchronise()

    def __enter__(self) -> DatasetWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        empty = len(self._states["index"]) == 0
        self._end_time[()] = now().encode()
        self._file.close()
        if empty:  # a run that failed before its first state leaves nothing behind
            self.path.unlink()

    def append_state(
        self,
        frames: Sequence[Frame],
        *,
        current_A: float,
        field_mT: float,
        measured_A: Sequence[float] | None = None,
        time_s: Sequence[float] | None = None,
        tip_force_N: float = 0.0,
        flags: tuple[Flag, ...] = (),
    ) -> None:
        """Store a state and its frames; once this has returned they survive a crash of program or machine.

        measured_A and time_s (seconds on the run's clock) have one value a frame. Raises ValueError for frames of
        another size.
        """
        images = np.stack([grey(frame.image) for frame in frames])
        if images.shape[1:] != self._frames.shape[1:] or images.dtype != self._frames.dtype:
            raise ValueError(
                f"frames are {images.shape[1:]} {images.dtype}, "
                f"those before {self._frames.shape[1:]} {self._frames.dtype}"
            )
        count, index = len(frames), len(self._states["index"])
        append(self._frames, images)
        rows = {
            "state": [index] * count,
            "number": [frame.number for frame in frames],
            "timestamp": [frame.timestamp_s for frame in frames],
            "time": time_s or [NAN] * count,
            "set_current": [current_A] * count,
            "measured_current": measured_A or [NAN] * count,
            "field": [field_mT] * count,
        }
        for name, column in self._columns.items():
            append(column, rows[name])
        state = {
            "current": current_A,
            "field": field_mT,
            "tip_force": tip_force_N,
            "flags": flags_to_text(flags),
            "index": index,
        }
        for dataset in (self._frames, *self._columns.values()):
            dataset.flush()
        for name, column in self._states.items():
            append(column, [state[name]])
            column.flush()
        self._synchronise()

    def _synchronise(self) -> None:
        self._file.flush()
        os.fsync(self._file.id.get_vfd_handle())
