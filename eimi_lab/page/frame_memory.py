"""The newest frame of a run, in memory that the run and the page share: the run never waits, the page takes the newest.

Two places are filled in turn. Whoever reads one sees by its counters whether it was written meanwhile, and tries again.
"""

from __future__ import annotations

import json
import mmap
import os
import struct
import tempfile
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

PLACE_BYTES = 64 << 20  # as much as a frame may have; only what is written takes memory
ABOUT_BYTES = 1 << 12
_NEWEST = struct.Struct("<Q")
_PLACE = struct.Struct(
    "<QQIIIIII"
)  # begun, ended, height, width, channels, bytes of a pixel, kept share, bytes about it
_FIRST = 4096
_TRIES = 5


@dataclass(frozen=True)
class Seen:
    """A frame with what the run says of it. number: counted by the memory. kept: every how-manieth pixel is in it."""

    number: int
    image: NDArray[Any]
    about: dict[str, Any]
    kept: int


def new_memory() -> int:
    """A descriptor of memory for `FrameMemory`, to be inherited; it has no name and goes with its last holder."""
    if hasattr(os, "memfd_create"):
        descriptor = os.memfd_create("frames")
    else:
        with tempfile.TemporaryFile() as file:
            descriptor = os.dup(file.fileno())
    os.ftruncate(descriptor, _FIRST + 2 * PLACE_BYTES)
    return descriptor


class FrameMemory:
    """One process writes, another one reads."""

    def __init__(self, descriptor: int) -> None:
        self._memory = mmap.mmap(descriptor, _FIRST + 2 * PLACE_BYTES)

    def newest(self) -> int:
        """The number of the newest frame; 0 before there is one."""
        return int(_NEWEST.unpack_from(self._memory, 0)[0])

    def write(self, image: NDArray[Any], about: dict[str, Any]) -> None:
        """Put a frame (H, W) or (H, W, 3) in the place of the older one; never waits."""
        kept = 1
        while image.nbytes > PLACE_BYTES - ABOUT_BYTES - _PLACE.size:
            image, kept = image[::2, ::2], 2 * kept
        image = np.ascontiguousarray(image)
        number, text = self.newest() + 1, json.dumps(about).encode()[:ABOUT_BYTES]
        at = self._place(number)
        height, width = image.shape[:2]
        channels = image.shape[2] if image.ndim == 3 else 0
        sizes = (height, width, channels, image.itemsize, kept, len(text))
        _PLACE.pack_into(self._memory, at, number, 0, *sizes)
        begin = at + _PLACE.size
        self._memory[begin : begin + len(text)] = text
        begin += ABOUT_BYTES
        self._memory[begin : begin + image.nbytes] = image.reshape(-1).view(np.uint8).data
        _PLACE.pack_into(self._memory, at, number, number, *sizes)
        _NEWEST.pack_into(self._memory, 0, number)

    def read(self, after: int) -> Seen | None:
        """The newest frame; None where there is none after that of a number."""
        for _ in range(_TRIES):
            number = self.newest()
            if number <= after:
                return None
            at = self._place(number)
            begun, ended, height, width, channels, itemsize, kept, told = _PLACE.unpack_from(self._memory, at)
            begin = at + _PLACE.size
            text = self._memory[begin : begin + told]
            begin += ABOUT_BYTES
            pixels = self._memory[begin : begin + height * width * max(1, channels) * itemsize]
            if begun == ended == _PLACE.unpack_from(self._memory, at)[0]:
                shape = (height, width, channels) if channels else (height, width)
                image = np.frombuffer(pixels, np.uint8 if itemsize == 1 else np.uint16).reshape(shape)
                return Seen(number, image, json.loads(text), kept)
        return None

    @staticmethod
    def _place(number: int) -> int:
        return _FIRST + number % 2 * PLACE_BYTES
