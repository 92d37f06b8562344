"""Frames that are compressed in threads and written while they arrive, faster than HDF5's own filters allow.

HDF5 compresses in the thread that writes, one chunk after another. Here several threads compress frames
(`frame_chunk`), and another thread writes the finished chunks in their order.

At most a stated number of bytes of frames is in memory. If the disk or the processors are too slow, `put` waits.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from eimi_lab.dataset.frame_chunk import compressed, write_chunk
from eimi_lab.dataset.layout import to_stored

RING_BYTES = 512 << 20
"""Frames in memory that are not yet on the disk: three seconds of 120 frames of 1.3 MB."""

COMPRESSING = 2
"""Threads that compress; igzip leaves Python's lock while it works."""

_AHEAD = 64  # frames by which the stack is lengthened at once


class FrameStream:
    """Appends frames to a stack; use it as a context manager, whose end waits until all frames are written.

    Parameters
    ----------
    frames : h5py.Dataset
        The stack, created by `layout.frame_stack`. Nothing else may use its file before the end.
    ring_bytes : int
        Largest number of bytes of frames in memory.

    Attributes
    ----------
    written : int
        Number of frames that were written.
    """

    def __init__(self, frames: h5py.Dataset, ring_bytes: int = RING_BYTES) -> None:
        self._frames, self._first = frames, len(frames)
        self._shape, self._dtype = frames.shape[1:], frames.dtype
        self._room = threading.BoundedSemaphore(
            max(2, ring_bytes // max(1, frames.dtype.itemsize * _size(self._shape)))
        )
        self._compressing = ThreadPoolExecutor(COMPRESSING, "compress")
        self._writing = ThreadPoolExecutor(1, "write frames")
        self._error: BaseException | None = None
        self._accepted = self._finished = self.written = 0

    @property
    def waiting(self) -> int:
        """The number of frames in memory."""
        return self._accepted - self._finished

    def __enter__(self) -> FrameStream:
        return self

    def put(self, image: NDArray[Any], meanwhile: Callable[[], None] | None = None) -> None:
        """Accept the next frame, which must not change afterwards.

        Parameters
        ----------
        image : ndarray
            The frame, colours in the program's order.
        meanwhile : callable, optional
            Is called repeatedly while there is no room in memory.

        Raises
        ------
        ValueError
            If the frame has another size or depth than the stack.
        OSError, RuntimeError
            If an earlier frame could not be written.
        """
        if image.shape != self._shape or image.dtype != self._dtype:
            raise ValueError(
                f"frames are {image.shape} {image.dtype}, the frames before are {self._shape} {self._dtype}"
            )
        while not self._room.acquire(timeout=0.1):
            if meanwhile:
                meanwhile()
        if self._error:
            raise self._error
        chunk = self._compressing.submit(_stored_chunk, image)
        self._writing.submit(self._write, self._accepted, chunk)
        self._accepted += 1

    def _write(self, number: int, chunk: Future[bytes]) -> None:
        try:
            data = chunk.result()
            if self._error:
                return
            row = self._first + number
            if row >= len(self._frames):
                self._frames.resize(row + _AHEAD, axis=0)
            write_chunk(self._frames, row, data)
            self.written = number + 1
        except BaseException as error:  # raised again in the thread of the caller
            self._error = error
        finally:
            self._finished += 1
            self._room.release()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Wait until every accepted frame is written, and cut the stack to the written frames.

        Raises OSError or RuntimeError if a frame could not be written.
        """
        self._compressing.shutdown()
        self._writing.shutdown()
        if self._error is None:
            self._frames.resize(self._first + self.written, axis=0)
            self._frames.flush()
        elif error is None:
            raise self._error


def _size(shape: tuple[int, ...]) -> int:
    return int(np.prod(shape, dtype=object))


def _stored_chunk(image: NDArray[Any]) -> bytes:
    return compressed(to_stored(image))
