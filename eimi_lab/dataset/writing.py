"""Writing a dataset of frames so that what was acknowledged survives a crash.

HDF5's single-writer-multiple-reader mode orders its writes such that a file is readable at every moment; each state is
flushed dataset by dataset, the table of states last, and synchronised to the disk before `append_state` returns.
The order comes from The HDF Group's user guide to SWMR: create everything first, then open the file in the mode. The
file is made under another name, so that none without its header ever bears the one that was asked for.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py
import numpy as np
from h5py import h5f, h5p
from numpy.typing import NDArray

from eimi_drivers.interfaces import Frame
from eimi_lab.dataset.grey import grey
from eimi_lab.dataset.layout import (
    FRAME_COLUMNS,
    SESSION_COLUMNS,
    STATE_COLUMNS,
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
from eimi_lab.errors import InputError
from eimi_lab.outputs import whole_file
from eimi_lab.vision.edge_set import Flag

NAN = float("nan")


class StorageFailed(OSError):
    """The disk takes no more; what was acknowledged is safe."""


class DatasetWriter:
    """Appends one state after another to a file; use as a context manager.

    Needs a local file system: network file systems do not keep the order of writes.
    """

    def __init__(self, path: Path, header: Header, like: Frame, force: bool = False) -> None:
        """Create the file for frames of the size and depth of `like`. Raises InputError where a file exists."""
        with whole_file(path, force) as temporary:
            temporary.write_bytes(_empty_file(header, grey(like.image)))
        self._open(path)

    @classmethod
    def resume(cls, path: Path) -> DatasetWriter:
        """Go on with a file that was closed properly, or recovered. Raises InputError."""
        writer = cls.__new__(cls)
        writer._open(path)
        return writer

    def _open(self, path: Path) -> None:
        self.path = path
        try:
            self._file = h5py.File(h5f.open(os.fsencode(path), h5f.ACC_RDWR | h5f.ACC_SWMR_WRITE, _access()))
        except OSError as error:
            raise InputError(f"{path}: cannot be opened to write; is it open in another program? ({error})") from error
        self._descriptor = self._file.id.get_vfd_handle()
        self._abandoned = False
        entry = self._file["entry"]
        self._frames = entry["data/frames"]
        self._columns = {name: entry["data"][name] for name in FRAME_COLUMNS}
        self._states = {name: entry["states"][name] for name in STATE_COLUMNS}
        self._end_time = entry["end_time"]
        self._stored = len(self._states["index"])
        session = {"start": now().encode(), "first_state": self._stored}
        with self._writing():
            for name in SESSION_COLUMNS:
                append(entry["sessions"][name], [session[name]])
                entry["sessions"][name].flush()
            self._synchronise()

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except (OSError, RuntimeError) as error:
            self._abandon()
            number = re.search(r"errno = (\d+)", str(error))
            reason = os.strerror(int(number[1])) if number else str(error)
            raise StorageFailed(
                f"{self.path}: cannot be written any more: {reason}; the {self._stored} states acknowledged so far are "
                "safe, and `eimi acquire --resume` goes on from there"
            ) from error

    def _abandon(self) -> None:
        """Let go of the file as the last writes left it, as a crash would.

        HDF5 would try to write the rest when the file is closed, fail, and take the whole program down when that
        ends. So the rest goes to nowhere.
        """
        with open(os.devnull, "r+b", buffering=0) as nowhere:
            os.dup2(nowhere.fileno(), self._descriptor)
            with suppress(OSError, RuntimeError):
                self._file.close()
        self._abandoned = True
        if not self._stored:
            self.path.unlink()

    def __enter__(self) -> DatasetWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the file. One without a state is removed: a run that failed before its first leaves nothing behind."""
        if self._abandoned:
            return
        with self._writing():
            self._end_time[()] = now().encode()
            self._file.flush()
            self._file.close()
        if not self._stored:
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
        another size, StorageFailed where the disk takes no more.
        """
        images = np.stack([grey(frame.image) for frame in frames])
        if images.shape[1:] != self._frames.shape[1:] or images.dtype != self._frames.dtype:
            raise ValueError(
                f"frames are {images.shape[1:]} {images.dtype}, "
                f"those before {self._frames.shape[1:]} {self._frames.dtype}"
            )
        count, index = len(frames), self._stored
        rows = {
            "state": [index] * count,
            "number": [frame.number for frame in frames],
            "timestamp": [frame.timestamp_s for frame in frames],
            "time": time_s or [NAN] * count,
            "set_current": [current_A] * count,
            "measured_current": measured_A or [NAN] * count,
            "field": [field_mT] * count,
        }
        state = {
            "current": current_A,
            "field": field_mT,
            "tip_force": tip_force_N,
            "flags": flags_to_text(flags),
            "index": index,
        }
        with self._writing():
            append(self._frames, images)
            for name, column in self._columns.items():
                append(column, rows[name])
            for dataset in (self._frames, *self._columns.values()):
                dataset.flush()
            for name, column in self._states.items():
                append(column, [state[name]])
                column.flush()
            self._synchronise()
        self._stored += 1

    def _synchronise(self) -> None:
        self._file.flush()
        os.fsync(self._descriptor)


def _access() -> h5p.PropFAID:
    access = h5p.create(h5p.FILE_ACCESS)
    access.set_libver_bounds(h5f.LIBVER_LATEST, h5f.LIBVER_LATEST)
    return access


def _empty_file(header: Header, image: NDArray[Any]) -> bytes:
    """A dataset for frames like (H, W) `image`, without any; made in memory, where no disk can be full."""
    height, width = image.shape
    with h5py.File("memory", "w", libver="latest", driver="core", backing_store=False) as file:
        entry = write_header(file, header)
        detector = group(entry["instrument"], "detector", "NXdetector")
        frames = detector.create_dataset(
            "data",
            shape=(0, height, width),
            maxshape=(None, height, width),
            chunks=(1, height, width),
            dtype=image.dtype,
            compression="gzip",
            compression_opts=1,
            fletcher32=True,
        )
        frames.attrs["units"] = "counts"
        put_text(detector, "description", "side camera")
        if settings := header.camera_settings.chosen():
            read_back = group(detector, "settings", "NXcollection")
            for name, value in settings.items():
                read_back[name] = value

        data = group(entry, "data", "NXdata")
        data.attrs["signal"] = "frames"
        data.attrs["axes"] = ["field", ".", "."]
        data["frames"] = frames
        of_frame = columns(data, FRAME_COLUMNS)

        supply = group(entry["instrument"], "supply", "NXcollection")
        for name in ("set_current", "measured_current"):
            log = group(supply, name, "NXlog")
            log["time"] = of_frame["time"]
            log["value"] = of_frame[name]

        columns(group(entry, "sessions", "NXcollection"), SESSION_COLUMNS)
        write_state_columns(entry, "frames")
        file.flush()
        return bytes(file.id.get_file_image())
