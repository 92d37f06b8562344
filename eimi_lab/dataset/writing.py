"""Write a dataset of frames so that every stored load step survives a crash.

The file is written in HDF5's single-writer-multiple-reader mode (The HDF Group, SWMR user guide). The table of load
steps is written last, so that it lists only complete load steps.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py
import numpy as np
from h5py import h5f, h5p
from numpy.typing import NDArray

from eimi_drivers.interfaces import Frame, SensorReading
from eimi_lab.dataset.empty_file import empty_file
from eimi_lab.dataset.frame_chunk import append_image
from eimi_lab.dataset.frame_stream import FrameStream
from eimi_lab.dataset.layout import (
    FRAME_COLUMNS,
    SESSION_COLUMNS,
    STATE_COLUMNS,
    Header,
    append,
    flags_to_text,
    now,
    to_stored,
)
from eimi_lab.dataset.lost_name import copy_beside, fate_of, head_of
from eimi_lab.dataset.recordings import (
    BELONGS_TO,
    RING_DOWN,
    TRANSIENTS,
    Moment,
    append_moments,
    append_times,
)
from eimi_lab.dataset.sensor_logs import log_of, rows_of, sensor_names
from eimi_lab.dataset.steps import (
    RING_DOWN_STEPS,
    SET_POINTS,
    RingDownStep,
    SetPoint,
    append_set_points,
    append_step,
)
from eimi_lab.dataset.storage_failure import CONTINUE_STORED, StorageFailed
from eimi_lab.process.errors import InputError, tell
from eimi_lab.process.outputs import whole_file
from eimi_lab.process.replacing import patiently, remove
from eimi_lab.process.synchronising import synchronise
from eimi_lab.process.writer_lock import WriterLock
from eimi_lab.vision.check import Flag

NAN = float("nan")


def _ignore() -> None:
    """Do nothing."""


def _tell_warning(message: str) -> None:
    tell(f"warning: {message}")


# The arrays are flushed one after another, and the table of load steps last, before the file is synchronised to the
# disk. All arrays are created before the file is opened in single-writer-multiple-reader mode, and under a temporary
# name, so that every file with the requested name contains the description of the run.
class DatasetWriter:
    """A writer that creates a dataset and appends one load step after another. Use it in a ``with`` statement.

    The file must be on a local file system.

    Parameters
    ----------
    path
        The new file. If another program moves, deletes or replaces it during a run, its contents are written to a copy,
        whose path then replaces this value.
    header
        Description of the run.
    like
        An example frame, which has the size and the bit depth of all frames.
    force
        Whether an existing file is overwritten.
    beat
        Function that is called repeatedly while a load step is written.
    warn
        Function that gets the text of a warning; by default it is printed on standard error.

    Raises
    ------
    InputError
        If the file exists and ``force`` is False, or if another writer uses the path.
    """

    def __init__(
        self,
        path: Path,
        header: Header,
        like: Frame,
        force: bool = False,
        beat: Callable[[], None] = _ignore,
        warn: Callable[[str], None] = _tell_warning,
    ) -> None:
        self._beat, self._warn = beat, warn
        lock = WriterLock(path)
        try:
            with whole_file(path, force) as temporary:
                temporary.write_bytes(empty_file(header, like.image))
            self._open(path, lock)
        except BaseException:
            lock.release()
            raise

    @classmethod
    def resume(
        cls, path: Path, beat: Callable[[], None] = _ignore, warn: Callable[[str], None] = _tell_warning
    ) -> DatasetWriter:
        """Return a writer that appends load steps to a dataset that was closed properly or recovered.

        ``beat`` is called repeatedly during writing, and ``warn`` gets the text of a warning. Raises InputError if the
        file cannot be opened for writing, or if another writer uses the path.
        """
        writer = cls.__new__(cls)
        writer._beat, writer._warn = beat, warn
        lock = WriterLock(path)
        try:
            writer._open(path, lock)
            writer._end_last_set_point()
        except BaseException:
            lock.release()
            raise
        return writer

    def _open(self, path: Path, lock: WriterLock) -> None:
        self._attach(path, lock)
        self.begin_session()

    def begin_session(self) -> None:
        """Store the present time as the start or the continuation of the run.

        Raises StorageFailed if the file cannot be written.
        """
        session = {"start": now().encode(), "first_state": self._stored, "end": b""}
        with self._writing():
            for name, column in self._sessions.items():
                append(column, [session[name]])
                column.flush()
            self._synchronise()

    def _end_last_set_point(self) -> None:
        """Store a set-point of 0 A at the last known time, if a crashed run stored no set-point of 0 A at its end."""
        if self._set_points and len(currents := self._set_points["current"]) and currents[-1]:
            last_s = np.nanmax([self._set_points["time"][-1], *self._columns["time"][()]])
            self.append_set_points([SetPoint(float(last_s), 0.0, NAN)])

    def _attach(self, path: Path, lock: WriterLock) -> None:
        self.path, self._lock = path, lock
        try:
            flags = h5f.ACC_RDWR | h5f.ACC_SWMR_WRITE
            self._file = h5py.File(patiently(lambda: h5f.open(os.fsencode(path), flags, _access())))
        except OSError as error:
            raise InputError(
                f"{path}: cannot be opened for writing ({error}); close every other program that has it open, or make "
                "a copy with `eimi recover`"
            ) from error
        self._descriptor = self._file.id.get_vfd_handle()
        self._head = b""
        self._abandoned = False
        entry = self._file["entry"]
        self._frames = entry["data/frames"]
        self._columns = {name: entry["data"][name] for name in FRAME_COLUMNS}
        self._states = {name: entry["states"][name] for name in STATE_COLUMNS}
        self._sensors = {name: log_of(entry, name) for name in sensor_names(entry)}
        self._end_time = entry.get("end_time")  # in a file of version 0.1.0, whose sessions have no column `end`
        self._sessions = {name: entry["sessions"][name] for name in SESSION_COLUMNS if name in entry["sessions"]}
        self._recordings = {name: dict(entry[name]) for name in BELONGS_TO if name in entry}
        self._set_points, self._steps = (dict(entry.get(name, {})) for name in (SET_POINTS, RING_DOWN_STEPS))
        self._stored = len(self._states["index"])
        self._ring_downs = len(self._steps["ring_down"]) if self._steps else None

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except (OSError, RuntimeError) as error:
            self._abandon()
            number = re.search(r"errno = (\d+)", str(error))
            reason = os.strerror(int(number[1])) if number else str(error)
            stored = "no state was stored yet"
            if self._stored:
                stored = f"the {self._stored} states stored so far are safe, and {CONTINUE_STORED}"
            raise StorageFailed(f"{self.path}: cannot be written any more: {reason}; {stored}", reason) from error

    def _abandon(self) -> None:
        """Close the file after a failed write, without writing to it. A file without a load step is removed."""
        taken_away = fate_of(self.path, self._descriptor)
        # HDF5 writes its remaining data when a file is closed. This write would fail too, and would crash the program.
        # Therefore the null device, which accepts the data, takes the place of the file.
        with open(os.devnull, "r+b", buffering=0) as null_device:
            os.dup2(null_device.fileno(), self._descriptor)
            with suppress(OSError, RuntimeError):
                self._file.close()
        self._abandoned = True
        if not self._stored and not taken_away:
            remove(self.path)
        self._lock.release()

    @property
    def stored(self) -> int:
        """The number of load steps that are stored in the file."""
        return self._stored

    def __enter__(self) -> DatasetWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the file. A file without a load step is removed."""
        if self._abandoned:
            return
        self._refuse_overwritten()
        if self._stored:
            self._keep_the_name()
        taken_away = fate_of(self.path, self._descriptor)
        self._close()
        if not self._stored and not taken_away:
            remove(self.path)
        self._lock.release()

    def _close(self) -> None:
        with self._writing():
            if "end" in self._sessions:
                self._sessions["end"][-1] = now().encode()
            elif self._end_time is not None:
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
        sensed: Sequence[Mapping[str, SensorReading]] = (),
        set_points: Sequence[SetPoint] = (),
    ) -> None:
        """Store a load step with its frames, which then survive a crash of the program or of the computer.

        Parameters
        ----------
        frames
            The frames.
        current_A, field_mT, tip_force_N
            Set current (A), field at the magnet (mT) and force at the tip (N).
        measured_A, time_s
            For each frame, the measured current (A), and the time on the clock of the run (s).
        flags
            Defects of the frames.
        transient
            Frames that were taken while the beam settled.
        sensed
            For each frame, the readings of the sensors by name.
        set_points
            Set-points that were sent after the previous load step was stored.

        Raises
        ------
        ValueError
            If a frame differs from the frames of the file in size or bit depth.
        StorageFailed
            If the disk accepts no more data, or if another program wrote into the file.
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
                append_image(self._frames, image)
                self._beat()
            for name, column in self._columns.items():
                append(column, rows[name])
            logs = [column for log in self._sensors.values() for column in log.values()]
            for name, log in self._sensors.items():
                for column, values in rows_of(name, sensed, number).items():
                    append(log[column], values)
            for dataset in (self._frames, *self._columns.values(), *logs):
                dataset.flush()
            self._append_moments(TRANSIENTS, [index] * len(transient), transient)
            append_set_points(self._set_points, set_points)
            for name, column in self._states.items():
                append(column, [state[name]])
                column.flush()
            self._synchronise()
        self._stored += 1
        self._keep_the_name()

    def append_recording(self, name: str, belongs_to: Sequence[int], moments: Sequence[Moment]) -> None:
        """Store frames in addition to those of the load steps. These frames then survive a crash.

        Raises ValueError if a frame differs from the frames of the file, and StorageFailed if the file cannot be
        written.

        Parameters
        ----------
        name
            Name of the series of frames, such as "transients".
        belongs_to
            Number of the load step, load cycle or free oscillation of each frame.
        moments
            The frames with their times and set-points.
        """
        self._refuse_overwritten()
        with self._writing():
            self._append_moments(name, belongs_to, moments)
            self._synchronise()
        if self._stored:
            self._keep_the_name()

    def append_set_points(self, set_points: Sequence[SetPoint]) -> None:
        """Store set-points that were sent after the last load step, such as those of the ramp to zero at the end.

        Nothing is stored after a failed write, or if the file has no table for set-points. Raises StorageFailed if the
        file cannot be written.
        """
        if not set_points or not self._set_points or self._abandoned:
            return
        self._refuse_overwritten()
        with self._writing():
            append_set_points(self._set_points, set_points)
            self._synchronise()
        if self._stored:
            self._keep_the_name()

    @property
    def ring_downs(self) -> int | None:
        """The number of stored free oscillations; None if the file has no table for them."""
        return self._ring_downs

    @contextmanager
    def ring_down(self) -> Iterator[FrameStream]:
        """Yield a stream for a ``with`` statement that writes the frames of a free oscillation in the background.

        Call `end_ring_down` afterwards. Raises StorageFailed if the file cannot be written.
        """
        self._refuse_overwritten()
        with self._writing(), FrameStream(self._recordings[RING_DOWN]["frames"]) as stream:
            yield stream

    def end_ring_down(self, step: RingDownStep, moments: Sequence[Moment], set_points: Sequence[SetPoint]) -> None:
        """Store the step of the current that began a free oscillation, and the times of its frames.

        The free oscillation then survives a crash. Raises StorageFailed if the file cannot be written.

        Parameters
        ----------
        step
            The step of the current.
        moments
            Times and set-points of the frames, which are already in the file.
        set_points
            Set-points that were sent after the previous load step or free oscillation was stored.
        """
        with self._writing():
            append_set_points(self._set_points, set_points)
            append_times(RING_DOWN, self._recordings[RING_DOWN], [step.ring_down] * len(moments), moments)
            append_step(self._steps, step)
            self._synchronise()
        if self._ring_downs is not None:
            self._ring_downs += 1
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
                f"the new frames have the shape {images.shape[1:]} and the type {images.dtype}, but the frames before "
                f"have {self._frames.shape[1:]} and {self._frames.dtype}; all frames of a dataset should have the "
                "same shape and type"
            )
        return images

    def _refuse_overwritten(self) -> None:
        """Raise StorageFailed if another program changed the beginning of the file."""
        if head_of(self._descriptor) != self._head:
            self._abandon()
            raise StorageFailed(
                f"{self.path}: another program wrote into the file during the run, so the {self._stored} states stored "
                "so far may be lost; repeat the run with another file name, and let no other program write this file"
            )

    def _keep_the_name(self) -> None:
        """Continue in a copy if another program deleted, moved or replaced the file.

        Raises StorageFailed if the file cannot be copied or written.
        """
        if not (fate := fate_of(self.path, self._descriptor)):
            return
        source = os.dup(self._descriptor)  # a deleted file can be read as long as it is open
        taken_from, old_lock = self.path, self._lock
        try:
            self._close()
            self._abandoned = True  # until the copy is open for writing
            self._attach(*copy_beside(taken_from, source, fate, self._beat))
        finally:
            os.close(source)
            old_lock.release()
        self._head = head_of(self._descriptor)
        self._warn(
            f"{taken_from} {fate} during the run; the {self._stored} states stored so far and all following states "
            f"are in {self.path}"
        )

    def _synchronise(self) -> None:
        self._file.flush()
        synchronise(self._descriptor, self._beat)
        self._head = head_of(self._descriptor)


def _access() -> h5p.PropFAID:
    access = h5p.create(h5p.FILE_ACCESS)
    access.set_libver_bounds(h5f.LIBVER_V110, h5f.LIBVER_LATEST)
    return access
