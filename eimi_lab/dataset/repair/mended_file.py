"""A file with some of its bytes replaced for whoever reads it; the file itself stays as it is."""

from __future__ import annotations

import io
import mmap
import os
import re
from collections.abc import Iterator
from pathlib import Path


class MendedFile(io.RawIOBase):
    """A file to read, with some of its bytes replaced: what `h5py.File` takes for a file.

    patches: bytes by their place in the file. searched_bytes: hashed in vain so far, see `blocks.MOST_SEARCHED_BYTES`.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("rb")
        self.size = os.fstat(self._file.fileno()).st_size
        self._map = mmap.mmap(self._file.fileno(), 0, access=mmap.ACCESS_READ) if self.size else b""
        self.patches: dict[int, int] = {}
        self.searched_bytes = 0
        self._at = 0

    def bytes_at(self, at: int, length: int) -> bytes:
        """What stands there, fewer bytes at the end of the file."""
        found = self._map[at : at + length] if at >= 0 else b""
        if any(at <= place < at + len(found) for place in self.patches):
            patched = bytearray(found)
            for place, byte in self.patches.items():
                if at <= place < at + len(found):
                    patched[place - at] = byte
            return bytes(patched)
        return found

    def readable(self) -> bool:
        """Yes."""
        return True

    def seekable(self) -> bool:
        """Yes."""
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """See `io.RawIOBase.seek`."""
        self._at = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self.size}[whence]
        return self._at

    def tell(self) -> int:
        """See `io.RawIOBase.tell`."""
        return self._at

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        """See `io.RawIOBase.readinto`."""
        found = self.bytes_at(self._at, len(buffer))
        buffer[: len(found)] = found
        self._at += len(found)
        return len(found)

    def close(self) -> None:
        """Release the file."""
        if not self.closed and isinstance(self._map, mmap.mmap):
            self._map.close()
        self._file.close()
        super().close()

    def find(self, pattern: re.Pattern[bytes]) -> Iterator[int]:
        """Where a pattern stands in the file as it is."""
        return (match.start() for match in pattern.finditer(self._map))

    def patch(self, at: int, content: bytes) -> None:
        """Let other bytes stand there."""
        self.patches |= {at + offset: byte for offset, byte in enumerate(content)}

    def flip(self, at: int, bit: int) -> None:
        """Let a bit be the other one, counted from the lowest of the byte at a place."""
        place = at + bit // 8
        self.patch(place, bytes([self.bytes_at(place, 1)[0] ^ 1 << bit % 8]))
