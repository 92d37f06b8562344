"""Memory that a run and the live web page share: the run writes the newest frame, and the page reads it."""

# The memory has two slots, each for one frame. The run writes into the two slots in turn and never waits for the page.
# The page reads the slot with the newer frame. If the reading takes long, the run may overwrite this slot in the
# meantime. Two counters in the slot show this, and the page then reads again.

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

PLACE_BYTES = 64 << 20  # size of a slot; only the part that is written takes memory
ABOUT_BYTES = 1 << 12
_NEWEST = struct.Struct("<Q")
_PLACE = struct.Struct(
    "<QQIIIIII"
)  # counter before, counter after, height, width, channels, bytes per value, kept, bytes of the description
_FIRST = 4096
_TRIES = 5


@dataclass(frozen=True)
class NewestFrame:
    """A frame that was read from the shared memory.

    Parameters
    ----------
    number : int
        Number of the frame, counted from 1.
    image : ndarray, shape (H, W) or (H, W, 3)
        The image of H by W pixels, grey or with three colours.
    about : dict
        Number of the load step, set-point (A), measured current (A), whether the output of the supply is on, and rise
        of the coil's temperature as a share of the allowed rise.
    kept : int
        1 if the image has every pixel of the frame, 2 if it has every second pixel in both directions, and so on.
    """

    number: int
    image: NDArray[Any]
    about: dict[str, Any]
    kept: int


def new_memory() -> int:
    """Create the shared memory, and return its file descriptor."""
    if hasattr(os, "memfd_create"):
        descriptor = os.memfd_create("frames")
    else:
        with tempfile.TemporaryFile() as file:
            descriptor = os.dup(file.fileno())
    os.ftruncate(descriptor, _FIRST + 2 * PLACE_BYTES)
    return descriptor


class FrameMemory:
    """Shared memory with the newest frame. One process writes frames, and other processes read them."""

    def __init__(self, descriptor: int) -> None:
        self._memory = mmap.mmap(descriptor, _FIRST + 2 * PLACE_BYTES)

    def newest(self) -> int:
        """Return the number of the newest frame, or 0 before the first frame."""
        return int(_NEWEST.unpack_from(self._memory, 0)[0])

    def write(self, image: NDArray[Any], about: dict[str, Any]) -> None:
        """Write a frame into the shared memory.

        Parameters
        ----------
        image : ndarray, shape (H, W) or (H, W, 3)
            The image of H by W pixels. From an image that is too large, only every second pixel (or fourth, ...) is
            written.
        about : dict
            Description of the frame, as a JSON object.
        """
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

    def read(self, after: int) -> NewestFrame | None:
        """Return the newest frame if its number is larger than `after`; otherwise, or if it cannot be read, None."""
        for _ in range(_TRIES):
            number = self.newest()
            if number <= after:
                return None
            at = self._place(number)
            begun, ended, height, width, channels, itemsize, kept, about_bytes = _PLACE.unpack_from(self._memory, at)
            begin = at + _PLACE.size
            text = self._memory[begin : begin + about_bytes]
            begin += ABOUT_BYTES
            pixels = self._memory[begin : begin + height * width * max(1, channels) * itemsize]
            if begun == ended == _PLACE.unpack_from(self._memory, at)[0]:
                shape = (height, width, channels) if channels else (height, width)
                image = np.frombuffer(pixels, np.uint8 if itemsize == 1 else np.uint16).reshape(shape)
                return NewestFrame(number, image, json.loads(text), kept)
        return None

    @staticmethod
    def _place(number: int) -> int:
        return _FIRST + number % 2 * PLACE_BYTES
