"""A file object that replaces some bytes of a file when they are read; the file on the disk does not change."""

from __future__ import annotations

import io
import mmap
import os
import re
from collections.abc import Iterator
from pathlib import Path


class MendedFile(io.RawIOBase):
    """A file that is open for reading, some of whose bytes are replaced in memory. `h5py.File` accepts this object.

    Attributes
    ----------
    size : int
        Size of the file in bytes.
    patches : dict of int to int
        The new value of each replaced byte, by its position in the file.
    searched_bytes : int
        Number of bytes that unsuccessful searches for a flipped bit have read.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("rb")
        self.size = os.fstat(self._file.fileno()).st_size
        self._map = mmap.mmap(self._file.fileno(), 0, access=mmap.ACCESS_READ) if self.size else b""
        self.patches: dict[int, int] = {}
        self.searched_bytes = 0
        self._at = 0

    def bytes_at(self, at: int, length: int) -> bytes:
        """Return `length` bytes from the position `at` (fewer at the end of the file), with the values in `patches`."""
        content = self._map[at : at + length] if at >= 0 else b""
        if any(at <= place < at + len(content) for place in self.patches):
            patched = bytearray(content)
            for place, byte in self.patches.items():
                if at <= place < at + len(content):
                    patched[place - at] = byte
            return bytes(patched)
        return content

    def readable(self) -> bool:
        """Return True."""
        return True

    def seekable(self) -> bool:
        """Return True."""
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Change the position in the file, and return the new position, bytes; arguments as for `io.IOBase.seek`."""
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self.size}[whence]
        return self._at

    def tell(self) -> int:
        """Return the present position in the file, bytes."""
        return self._at

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        """Fill `buffer` with bytes from the present position, and return the number of bytes."""
        content = self.bytes_at(self._at, len(buffer))
        buffer[: len(content)] = content
        self._at += len(content)
        return len(content)

    def close(self) -> None:
        """Close the file."""
        if not self.closed and isinstance(self._map, mmap.mmap):
            self._map.close()
        self._file.close()
        super().close()

    def find(self, pattern: re.Pattern[bytes]) -> Iterator[int]:
        """Yield the positions at which the bytes on the disk match a regular expression."""
        return (match.start() for match in pattern.finditer(self._map))

    def patch(self, at: int, content: bytes) -> None:
        """Replace the bytes that begin at the position `at` by `content`, in memory only."""
        self.patches |= {at + offset: byte for offset, byte in enumerate(content)}

    def flip(self, at: int, bit: int) -> None:
        """Flip one bit (0 is the lowest) of the byte at the position `at`, in memory only."""
        place = at + bit // 8
        self.patch(place, bytes([self.bytes_at(place, 1)[0] ^ 1 << bit % 8]))
