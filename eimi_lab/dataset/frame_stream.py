"""Compress frames in several threads, and write them in order in another thread, while the camera takes frames."""

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
"""Default limit for the size (bytes) of all frames that wait in memory: about 3 s of frames of 1.3 MB each, at 120
frames a second.
"""

COMPRESSING = 2
"""Number of threads that compress frames; they run in parallel, because igzip releases Python's interpreter lock."""

_AHEAD = 64  # number of frames by which the stack in the file is lengthened at once


class FrameStream:
    """A stream that appends frames to an HDF5 array of frames while the caller takes further frames.

    Use the stream in a ``with`` statement, which ends when all frames are written.

    Parameters
    ----------
    frames : h5py.Dataset
        The array, created by `layout.frame_stack`. During the with statement, nothing else may use the file.
    ring_bytes : int
        Largest number of bytes of frames in memory; two frames are always allowed.

    Attributes
    ----------
    written : int
        Number of frames that were written to the file.
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
        """The number of frames that are accepted and not yet written."""
        return self._accepted - self._finished

    def __enter__(self) -> FrameStream:
        return self

    def put(self, image: NDArray[Any], meanwhile: Callable[[], None] | None = None) -> None:
        """Accept the next frame for writing; wait if too many frames are in memory.

        Parameters
        ----------
        image : ndarray, shape (H, W) or (H, W, 3: blue, green, red)
            The frame. The caller must not change the array afterwards.
        meanwhile : callable, optional
            Function that is called every 0.1 s during the wait.

        Raises
        ------
        ValueError
            If the frame differs from earlier frames in size or bit depth.
        OSError, RuntimeError
            If an earlier frame could not be written.
        """
        if image.shape != self._shape or image.dtype != self._dtype:
            raise ValueError(
                f"the new frame has the shape {image.shape} and the type {image.dtype}, but the frames before have "
                f"{self._shape} and {self._dtype}; all frames of a recording should have the same shape and type"
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
        """Wait until all frames are written. Raises OSError or RuntimeError if a frame could not be written."""
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
