"""Writing a dataset of frames so that what was acknowledged survives a crash.

HDF5's single-writer-multiple-reader mode orders its writes such that a file is readable at every moment; each state is
flushed dataset by dataset, the table of states last, and synchronised to the disk before `append_state` returns.
The order comes from The HDF Group's user guide to SWMR: create everything first, then open the file in the mode. The
file is made under another name, so that none without its header ever bears the one that was asked for.

The name belongs to one writer at a time. Before a state is acknowledged the name must still lead to the file that was
written: one that was deleted, moved or replaced goes on as a copy beside it.
"""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py
import numpy as np
from h5py import h5f, h5p
from numpy.typing import NDArray

from eimi_drivers.interfaces import Frame
from eimi_lab.dataset.layout import (
    FRAME_COLUMNS,
    SESSION_COLUMNS,
    STATE_COLUMNS,
    Header,
    append,
    columns,
    flags_to_text,
    frame_stack,
    group,
    now,
    put_text,
    to_stored,
    write_header,
    write_state_columns,
)
from eimi_lab.dataset.recordings import (
    BELONGS_TO,
    TRANSIENTS,
    Moment,
    append_moments,
    make_recordings,
    planned,
)
from eimi_lab.process.errors import InputError, tell
from eimi_lab.process.outputs import whole_file
from eimi_lab.process.writer_lock import WriterLock
from eimi_lab.vision.check import Flag

NAN = float("nan")
HEAD_BYTES = 4096
"""Of the beginning of the file, which changes with every state, and which nobody else may have changed."""
COPY_BYTES = 1 << 20


def _nobody() -> None:
    """For a writer that nobody waits for."""


class StorageFailed(OSError):
    """The disk takes no more; what was acknowledged is safe."""

    def __init__(self, message: str, reason: str = "") -> None:
        """reason: that of the system alone."""
        super().__init__(message)
        self.reason = reason


def _tell_warning(message: str) -> None:
    tell(f"warning: {message}")


class DatasetWriter:
    """Appends one state after another to a file; use as a context manager.

    path: where the states are, which is another file from the moment on when the first was taken away.
    beat: called again and again while a state is written, to say that the run moves on.
    warn: is given what a person should know; standard error unless given.
    Needs a local file system: network file systems do not keep the order of writes.
    """

    def __init__(
        self,
        path: Path,
        header: Header,
        like: Frame,
        force: bool = False,
        beat: Callable[[], None] = _nobody,
        warn: Callable[[str], None] = _tell_warning,
    ) -> None:
        """Create the file for frames of the size and depth of `like`. Raises InputError where a file exists."""
        self._beat, self._warn = beat, warn
        lock = WriterLock(path)
        try:
            with whole_file(path, force) as temporary:
                temporary.write_bytes(_empty_file(header, like.image))
            self._open(path, lock)
        except BaseException:
            lock.release()
            raise

    @classmethod
    def resume(
        cls, path: Path, beat: Callable[[], None] = _nobody, warn: Callable[[str], None] = _tell_warning
    ) -> DatasetWriter:
        """Go on with a file that was closed properly, or recovered. Raises InputError."""
        writer = cls.__new__(cls)
        writer._beat, writer._warn = beat, warn
        lock = WriterLock(path)
        try:
            writer._open(path, lock)
        except BaseException:
            lock.release()
            raise
        return writer

    def _open(self, path: Path, lock: WriterLock) -> None:
        self._attach(path, lock)
        self.begin_session()

    def begin_session(self) -> None:
        """Note that the run begins, or goes on, now, at the next state. Raises StorageFailed."""
        session = {"start": now().encode(), "first_state": self._stored}
        with self._writing():
            for name in SESSION_COLUMNS:
                append(self._sessions[name], [session[name]])
                self._sessions[name].flush()
            self._synchronise()

    def _attach(self, path: Path, lock: WriterLock) -> None:
        self.path, self._lock = path, lock
        try:
            self._file = h5py.File(h5f.open(os.fsencode(path), h5f.ACC_RDWR | h5f.ACC_SWMR_WRITE, _access()))
        except OSError as error:
            raise InputError(f"{path}: cannot be opened to write; is it open in another program? ({error})") from error
        self._descriptor = self._file.id.get_vfd_handle()
        self._head = b""
        self._abandoned = False
        entry = self._file["entry"]
        self._frames = entry["data/frames"]
        self._columns = {name: entry["data"][name] for name in FRAME_COLUMNS}
        self._states = {name: entry["states"][name] for name in STATE_COLUMNS}
        self._end_time = entry["end_time"]
        self._sessions = {name: entry["sessions"][name] for name in SESSION_COLUMNS}
        self._recordings = {name: dict(entry[name]) for name in BELONGS_TO if name in entry}
        self._stored = len(self._states["index"])

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except (OSError, RuntimeError) as error:
            self._abandon()
            number = re.search(r"errno = (\d+)", str(error))
            reason = os.strerror(int(number[1])) if number else str(error)
            left = "no state was stored yet"
            if self._stored:
                left = (
                    f"the {self._stored} states stored so far are safe, and `eimi acquire --resume` goes on from there"
                )
            raise StorageFailed(f"{self.path}: cannot be written any more: {reason}; {left}", reason) from error

    def _abandon(self) -> None:
        """Let go of the file as the last writes left it, as a crash would.

        HDF5 would try to write the rest when the file is closed, fail, and take the whole program down when that
        ends. So the rest goes to nowhere.
        """
        ours_is_gone = _gone(self.path, self._descriptor)
        with open(os.devnull, "r+b", buffering=0) as nowhere:
            os.dup2(nowhere.fileno(), self._descriptor)
            with suppress(OSError, RuntimeError):
                self._file.close()
        self._abandoned = True
        if not self._stored and not ours_is_gone:
            self.path.unlink()
        self._lock.release()

    @property
    def stored(self) -> int:
        """The states that are in the file."""
        return self._stored

    def __enter__(self) -> DatasetWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the file. One without a state is removed: a run that failed before its first leaves nothing behind."""
        if self._abandoned:
            return
        self._refuse_overwritten()
        if self._stored:
            self._keep_the_name()
        ours_is_gone = _gone(self.path, self._descriptor)
        self._close()
        if not self._stored and not ours_is_gone:
            self.path.unlink()
        self._lock.release()

    def _close(self) -> None:
        with self._writing():
            self._end_time[()] = now().encode()
            self._file.flush()
            self._file.close()

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
        transient: Sequence[Moment] = (),
    ) -> None:
        """Store a state and its frames; once this has returned they survive a crash of program or machine.

        measured_A and time_s (seconds on the run's clock) have one value a frame. transient: how the beam came to rest,
        of which a file that has no place for it keeps nothing. Raises ValueError for frames of another size,
        StorageFailed where the disk takes no more, or where another program wrote into the file. One that was deleted,
        moved or replaced is told of, and the states, earlier ones too, are in a new file beside it.
        """
        self._refuse_overwritten()
        images = self._images(frames)
        number, index = len(frames), self._stored
        rows = {
            "state": [index] * number,
            "number": [frame.number for frame in frames],
            "timestamp": [frame.timestamp_s for frame in frames],
            "time": time_s or [NAN] * number,
            "set_current": [current_A] * number,
            "measured_current": measured_A or [NAN] * number,
            "field": [field_mT] * number,
        }
        state = {
            "current": current_A,
            "field": field_mT,
            "tip_force": tip_force_N,
            "flags": flags_to_text(flags),
            "index": index,
        }
        with self._writing():
            for image in images:
                append(self._frames, image[np.newaxis])
                self._beat()
            for name, column in self._columns.items():
                append(column, rows[name])
            for dataset in (self._frames, *self._columns.values()):
                dataset.flush()
            self._append_moments(TRANSIENTS, [index] * len(transient), transient)
            for name, column in self._states.items():
                append(column, [state[name]])
                column.flush()
            self._synchronise()
        self._stored += 1
        self._keep_the_name()

    def append_recording(self, name: str, belongs_to: Sequence[int], moments: Sequence[Moment]) -> None:
        """Store frames between the states, with the state or cycle of each; once this has returned they are safe.

        name: one of `recordings.BELONGS_TO`. Raises as `append_state` does.
        """
        self._refuse_overwritten()
        with self._writing():
            self._append_moments(name, belongs_to, moments)
            self._synchronise()
        if self._stored:
            self._keep_the_name()

    def _append_moments(self, name: str, belongs_to: Sequence[int], moments: Sequence[Moment]) -> None:
        if moments and name in self._recordings:
            images = self._images([moment.frame for moment in moments])
            append_moments(name, self._recordings[name], images, belongs_to, moments, self._beat)

    def _images(self, frames: Sequence[Frame]) -> NDArray[Any]:
        images = np.stack([to_stored(frame.image) for frame in frames])
        if images.shape[1:] != self._frames.shape[1:] or images.dtype != self._frames.dtype:
            raise ValueError(
                f"frames are {images.shape[1:]} {images.dtype}, "
                f"those before {self._frames.shape[1:]} {self._frames.dtype}"
            )
        return images

    def _refuse_overwritten(self) -> None:
        """Raise StorageFailed where the file no longer begins as the last write left it."""
        if os.pread(self._descriptor, HEAD_BYTES, 0) != self._head:
            self._abandon()
            raise StorageFailed(
                f"{self.path}: another program wrote into it while the run did: the {self._stored} states acknowledged "
                "so far may be lost; begin again with another name, and let nothing copy over a file in use"
            )

    def _keep_the_name(self) -> None:
        """Where the name leads elsewhere by now, go on in a copy beside it. Raises StorageFailed."""
        if not (fate := _gone(self.path, self._descriptor)):
            return
        source = os.dup(self._descriptor)  # a deleted file can be read as long as somebody has it open
        taken_from, old_lock = self.path, self._lock
        try:
            self._close()
            self._abandoned = True  # until there is another file to write to
            self._attach(*_copy_beside(taken_from, source, fate, self._beat))
        finally:
            os.close(source)
            old_lock.release()
        self._head = os.pread(self._descriptor, HEAD_BYTES, 0)
        self._warn(
            f"{taken_from} {fate} while the run writes it; its {self._stored} states, and those to come, are "
            f"in {self.path}"
        )

    def _synchronise(self) -> None:
        self._file.flush()
        os.fsync(self._descriptor)
        self._head = os.pread(self._descriptor, HEAD_BYTES, 0)


def _gone(path: Path, descriptor: int) -> str:
    """What became of an open file that `path` does not lead to any more; empty where it still does."""
    try:
        ours = os.fstat(descriptor)
    except OSError:  # closed already
        return ""
    try:
        found = os.stat(path)
    except OSError:
        return "was moved" if ours.st_nlink else "was deleted"
    if os.path.samestat(ours, found):
        return ""
    return "was moved and another file has its name" if ours.st_nlink else "was replaced"


def _copy_beside(path: Path, source: int, fate: str, beat: Callable[[], None]) -> tuple[Path, WriterLock]:
    """Copy an open file to a new name beside `path`, in the temporary folder where that takes none.

    Raises StorageFailed.
    """
    reasons = []
    for folder in (path.parent, Path(tempfile.gettempdir())):
        try:
            folder.mkdir(parents=True, exist_ok=True)  # it may be the folder that was moved
            name = next(name for name in _names_beside(folder / path.name) if not name.exists())
            lock = WriterLock(name)
        except (OSError, InputError) as error:
            reasons.append(str(error))
            continue
        try:
            with whole_file(name, force=False) as temporary, temporary.open("wb") as copy:
                os.lseek(source, 0, os.SEEK_SET)
                while piece := os.read(source, COPY_BYTES):
                    copy.write(piece)
                    beat()
            return name, lock
        except (OSError, InputError) as error:
            reasons.append(str(error))
            lock.release()
    raise StorageFailed(f"{path}: {fate} while the run writes it, and no copy can be made: {'; '.join(reasons)}")


def _names_beside(path: Path) -> Iterator[Path]:
    yield path.with_stem(f"{path.stem}-continued")
    yield from (path.with_stem(f"{path.stem}-continued-{number}") for number in count(2))


def _access() -> h5p.PropFAID:
    access = h5p.create(h5p.FILE_ACCESS)
    access.set_libver_bounds(h5f.LIBVER_LATEST, h5f.LIBVER_LATEST)
    return access


def _empty_file(header: Header, image: NDArray[Any]) -> bytes:
    """A dataset for frames like `image`, without any; made in memory, where no disk can be full."""
    with h5py.File("memory", "w", libver="latest", driver="core", backing_store=False) as file:
        entry = write_header(file, header)
        detector = group(entry["instrument"], "detector", "NXdetector")
        frames = frame_stack(detector, "data", image)
        put_text(detector, "description", "side camera")
        if header.camera_settings and (settings := header.camera_settings.chosen()):
            read_back = group(detector, "settings", "NXcollection")
            for name, value in settings.items():
                read_back[name] = value

        data = group(entry, "data", "NXdata")
        data.attrs["signal"] = "frames"
        data.attrs["axes"] = ["field"] + ["."] * image.ndim
        data["frames"] = frames
        of_frame = columns(data, FRAME_COLUMNS)

        supply = group(entry["instrument"], "supply", "NXcollection")
        if header.without_contact:
            put_text(supply, "without_contact", header.without_contact)
        for name in ("set_current", "measured_current"):
            log = group(supply, name, "NXlog")
            log["time"] = of_frame["time"]
            log["value"] = of_frame[name]

        columns(group(entry, "sessions", "NXcollection"), SESSION_COLUMNS)
        make_recordings(entry, planned(header.protocol), image)
        write_state_columns(entry, "frames")
        file.flush()
        return bytes(file.id.get_file_image())
