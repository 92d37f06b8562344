"""Emulate a camera in another process, which writes frames at a constant rate into a ring buffer in shared memory."""

from __future__ import annotations

import multiprocessing
import time
from multiprocessing import shared_memory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eimi_drivers.cameras.settings import CameraSettings
from eimi_drivers.interfaces import Frame, Identity, InstrumentDisconnected, InstrumentTimeout
from tests.patience import PATIENCE_S

PRE_RENDERED = 24


def noisy_frames(width: int, height: int, noise_grey: float = 1.3) -> NDArray[np.uint8]:
    """Return frames of a dark beam with noise of `noise_grey` grey levels, shape (PRE_RENDERED, height, width)."""
    random = np.random.default_rng(0)
    across = np.abs(np.arange(width) - width / 2)
    still = np.tile(30 + 170 / (1 + np.exp(-(across - width / 25) / 1.0)), (height, 1))
    return np.stack(
        [
            np.rint(still + random.normal(0, noise_grey, still.shape)).clip(0, 255).astype(np.uint8)
            for _ in range(PRE_RENDERED)
        ]
    )


def _expose(name: str, size: tuple[int, int], rate_Hz: float, buffers: int, ready: Any, counts: Any) -> None:
    """Write frames at a constant rate into a ring buffer, until the parent process sets `counts[1]`.

    name : name of the shared memory
    size : width and height of a frame (px)
    buffers : number of frames in the ring
    ready : semaphore that counts the waiting frames
    counts : `counts[0]` is the number of frames that the parent process has taken
    """
    width, height = size
    images = noisy_frames(width, height)
    memory = shared_memory.SharedMemory(name)
    ring = np.ndarray((buffers, height, width), np.uint8, memory.buf)
    stamps = np.ndarray((buffers, 2), np.float64, memory.buf, offset=buffers * width * height)
    number, begun_s, written = 0, time.monotonic(), 0
    while not counts[1]:
        number += 1
        due_s = begun_s + number / rate_Hz
        time.sleep(max(0.0, due_s - time.monotonic()))
        if written - counts[0] < buffers:
            ring[written % buffers] = images[number % PRE_RENDERED]
            stamps[written % buffers] = number, due_s
            written += 1
            ready.release()
    del ring, stamps
    memory.close()


class StreamingCamera:
    """A camera whose `grab` returns a copy of the oldest frame in the ring buffer, and frees its place."""

    def __init__(self, width: int, height: int, rate_Hz: float, buffers: int = 32) -> None:
        context = multiprocessing.get_context("spawn")
        self._memory = shared_memory.SharedMemory(create=True, size=buffers * (width * height + 16))
        self._ring = np.ndarray((buffers, height, width), np.uint8, self._memory.buf)
        self._stamps = np.ndarray((buffers, 2), np.float64, self._memory.buf, offset=buffers * width * height)
        self._ready, self._counts = context.Semaphore(0), context.Array("q", 2, lock=False)
        self._buffers, self._taken = buffers, 0
        self.settings = CameraSettings(frame_rate_Hz=rate_Hz)
        arguments = (self._memory.name, (width, height), rate_Hz, buffers, self._ready, self._counts)
        self._process = context.Process(target=_expose, args=arguments, daemon=True)
        self._process.start()

    def wait_for_first_frame(self) -> None:
        """Wait until the other process has started and sends frames."""
        assert self._ready.acquire(timeout=PATIENCE_S)
        self._ready.release()

    def identify(self) -> Identity:
        return Identity("streaming", "pre-rendered frames of another process", "memory")

    def flush(self) -> None:
        while self._ready.acquire(block=False):
            self._free()

    def _free(self) -> None:
        self._taken += 1
        self._counts[0] = self._taken

    def grab(self, timeout_s: float) -> Frame:
        if not self._ready.acquire(timeout=timeout_s):
            if not self._process.is_alive():
                raise InstrumentDisconnected("memory: the other process has ended")
            raise InstrumentTimeout(f"memory: no frame within {timeout_s:g} s")
        place = self._taken % self._buffers
        number, stamp_s = self._stamps[place]
        image = self._ring[place].copy()
        self._free()
        return Frame(image, int(number), float(stamp_s))

    def close(self) -> None:
        if self._process.is_alive():
            self._counts[1] = 1
            self._process.join(2.0)
            self._process.kill()
            self._process.join()
            del self._ring, self._stamps
            self._memory.close()
            self._memory.unlink()
