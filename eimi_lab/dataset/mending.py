"""Single flipped bits in an HDF5 file, found by its checksums and put right, without HDF5 and without writing to it.

Files of this suite are of HDF5's latest format, in which every block of metadata ends with a checksum. A block is found
by its signature, in which one bit may be wrong, too; its length follows from its own first bytes or from its header.
See HDF5 File Format Specification 3.0, sections II to IV and VII.
"""

from __future__ import annotations

import io
import mmap
import os
import re
from collections.abc import Iterator
from pathlib import Path

import h5py

from eimi_lab.dataset.checksums import fletcher32, flipped_bit, flipped_bit_of_chunk, lookup3

SUPERBLOCK_BYTES = 48
SIGNATURE = b"\x89HDF\r\n\x1a\n"
FLAGS_AT, END_AT = 11, 28
CONTINUATION = 0x10
LONGEST_BLOCK = 1 << 14
MOST_SEARCHED_BYTES = 1 << 30
"""Of what is hashed in vain in one file: one with a flipped bit needs little of it, one cut in two would need hours."""
FLETCHER32 = 3
_FIRST = re.compile(b"OHDR")
_OTHERS = re.compile(b"EAHD|EAIB|EADB|FRHP|FHDB|BTHD|BTLF")


class MendedFile(io.RawIOBase):
    """A file to read, with some of its bytes replaced: what `h5py.File` takes for a file.

    patches: bytes by their place in the file. searched_bytes: hashed in vain so far, see MOST_SEARCHED_BYTES.
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


def is_hdf5(file: MendedFile) -> bool:
    """Whether it was an HDF5 file once: half of its signature or a header of an object is left."""
    sound = sum(found == meant for found, meant in zip(file.bytes_at(0, len(SIGNATURE)), SIGNATURE, strict=False))
    return file.size >= SUPERBLOCK_BYTES and (sound >= len(SIGNATURE) / 2 or any(True for _ in file.find(_FIRST)))


def close_superblock(file: MendedFile) -> None:
    """Let a file that was never closed read as a closed one, as HDF5's own h5clear does, and mend its superblock.

    Nothing is done to other versions of the superblock, which nobody writes to in the mode that this suite uses.
    """
    file.patch(0, SIGNATURE + b"\x03\x08\x08")
    _mend(file, 0, SUPERBLOCK_BYTES)
    head = bytearray(file.bytes_at(0, SUPERBLOCK_BYTES - 4))
    head[FLAGS_AT] = 0
    head[END_AT : END_AT + 8] = file.size.to_bytes(8, "little")
    file.patch(0, bytes(head) + lookup3(bytes(head)).to_bytes(4, "little"))


def mend_metadata(file: MendedFile) -> int:
    """Put flipped bits in blocks of metadata right; returns how many."""
    mended = 0
    for any_bit in (False, True):  # in most cases the signature itself is sound, and the search is short
        for at in file.find(_with_one_wrong(_FIRST) if any_bit else _FIRST):
            if _meant(file.bytes_at(at, 4), _FIRST):
                mended += _mend_header(file, at)
        for place in file.find(_with_one_wrong(_OTHERS) if any_bit else _OTHERS):
            signature = _meant(file.bytes_at(place, 4), _OTHERS)
            if signature:
                mended += _mend_block(file, place, signature)
        if mended:
            break
    return mended


def mend_chunks(file: MendedFile, dataset: h5py.Dataset) -> int:
    """Put a flipped bit in each chunk of a dataset right whose checksum is wrong; returns how many."""
    plist = dataset.id.get_create_plist()
    filters = [plist.get_filter(number)[0] for number in range(plist.get_nfilters())]
    if not dataset.chunks or filters[-1:] != [FLETCHER32]:
        return 0
    mended = 0
    for number in range(dataset.id.get_num_chunks()):
        chunk = dataset.id.get_chunk_info(number)
        raw = file.bytes_at(chunk.byte_offset, chunk.size)
        if len(raw) < max(chunk.size, 8) or fletcher32(raw[:-4]) == int.from_bytes(raw[-4:], "little"):
            continue
        bit = flipped_bit_of_chunk(raw)
        if bit is not None:
            _flip(file, chunk.byte_offset, bit)
            mended += 1
    return mended


def _with_one_wrong(pattern: re.Pattern[bytes]) -> re.Pattern[bytes]:
    names = pattern.pattern.split(b"|")
    return re.compile(b"|".join(name[:k] + b"." + name[k + 1 :] for name in names for k in range(4)), re.DOTALL)


def _meant(found: bytes, pattern: re.Pattern[bytes]) -> bytes | None:
    """The signature that differs from what was found by one bit at most."""
    for name in pattern.pattern.split(b"|"):
        if len(found) == 4 and (int.from_bytes(found, "little") ^ int.from_bytes(name, "little")).bit_count() <= 1:
            return name
    return None


def _mend_header(file: MendedFile, at: int) -> int:
    """An object header and the blocks that go on with it."""
    lengths = {_header_length(file.bytes_at(at, 64))}
    head = file.bytes_at(at, 64)
    for bit in range(32, 8 * min(len(head), 34)):  # a flipped bit may be in what tells the length
        changed = bytearray(head)
        changed[bit // 8] ^= 1 << bit % 8
        lengths.add(_header_length(bytes(changed)))
    mended, whole = _mend_any(file, at, sorted(lengths))
    if not whole:
        return 0
    header = file.bytes_at(at, whole)
    first = _header_length(header) - 4 - int.from_bytes(header[_width_at(header) :][: 1 << (header[5] & 3)], "little")
    going_on, seen = list(_continuations(header[first:-4], header[5])), set()
    while going_on:
        address, length = going_on.pop()
        if (address, length) in seen:  # a loop
            continue
        seen.add((address, length))
        outcome = _mend(file, address, length)
        mended += outcome is True
        if outcome is not False:
            going_on += _continuations(file.bytes_at(address, length)[4:-4], header[5])
    return mended


def _mend_any(file: MendedFile, at: int, lengths: list[int]) -> tuple[int, int]:
    """How many bits were put right in a block of one of these lengths, and the length; (0, 0) for none of them."""
    for length in lengths:
        if _is_sound(file, at, length):
            return 0, length
    for length in lengths:
        if _mend(file, at, length):
            return 1, length
    return 0, 0


def _header_length(head: bytes) -> int:
    """Of an object header of version 2 with its checksum; 0 for none (Specification, section IV.A.1.b)."""
    if len(head) < 34 or head[4] != 2:
        return 0
    at, width = _width_at(head), 1 << (head[5] & 3)
    return at + width + int.from_bytes(head[at : at + width], "little") + 4


def _width_at(head: bytes) -> int:
    """Where an object header tells its length."""
    return 6 + (16 if head[5] & 0x20 else 0) + (4 if head[5] & 0x10 else 0)


def _continuations(messages: bytes, flags: int) -> Iterator[tuple[int, int]]:
    """Place and length of the blocks that go on with an object header of these messages."""
    at, prefix = 0, 6 if flags & 4 else 4
    while at + prefix <= len(messages):
        length = int.from_bytes(messages[at + 1 : at + 3], "little")
        if messages[at] == CONTINUATION:
            body = messages[at + prefix : at + prefix + 16]
            yield int.from_bytes(body[:8], "little"), int.from_bytes(body[8:], "little")
        at += prefix + length


def _mend_block(file: MendedFile, at: int, signature: bytes) -> int:
    if signature == b"FHDB":
        return _mend_heap(file, at)
    return _mend_any(file, at, _block_lengths(file, at, signature))[0]


def _mend_heap(file: MendedFile, at: int) -> int:
    """The first block of a heap of names, with its checksum before the names (Specification, section III.G)."""
    header = file.bytes_at(int.from_bytes(file.bytes_at(at + 5, 8), "little"), 146)
    if len(header) < 146 or not header[9] & 2:
        return 0
    length, place = int.from_bytes(header[112:120], "little"), 13 + -(-header[128] // 8)
    block = file.bytes_at(at, length)
    if not place + 4 < len(block) == length <= LONGEST_BLOCK:
        return 0
    stored = int.from_bytes(block[place : place + 4], "little")
    block = block[:place] + bytes(4) + block[place + 4 :]
    computed = lookup3(block)
    if computed == stored:
        return 0
    if (computed ^ stored).bit_count() == 1:
        file.patch(at + place, computed.to_bytes(4, "little"))
        return 1
    bit = _search(file, block, stored)
    if bit is not None:
        _flip(file, at, bit)
    return bit is not None


def _block_lengths(file: MendedFile, at: int, signature: bytes) -> list[int]:
    """The lengths that a block of metadata may have (Specification, sections III.A.2, III.G and VII)."""
    match signature:
        case b"EAHD":
            return [72]
        case b"FRHP":
            return [146]
        case b"BTHD":
            return [38]
        case b"BTLF":  # records of 11 bytes: names of links in a heap
            return [6 + 11 * count + 4 for count in range(1, 47)]
    header = file.bytes_at(int.from_bytes(file.bytes_at(at + 6, 8), "little"), 72)
    if len(header) < 72 or not header[9] or not header[10]:
        return []
    size, bits, of_index, fewest, pointers = header[6:11]
    if signature == b"EAIB":
        blocks = 1 + bits - fewest.bit_length() + 1
        direct = 2 * (pointers.bit_length() - 1)
        return [14 + of_index * size + 8 * (2 * (pointers - 1)) + 8 * max(blocks - direct, 0) + 4]
    return [14 + -(-bits // 8) + size * (fewest << doubled) + 4 for doubled in range(8)]


def _is_sound(file: MendedFile, at: int, length: int) -> bool:
    block = file.bytes_at(at, length)
    return 8 < length <= LONGEST_BLOCK and len(block) == length and lookup3(block[:-4]) == _stored(block)


def _stored(block: bytes) -> int:
    return int.from_bytes(block[-4:], "little")


def _mend(file: MendedFile, at: int, length: int) -> bool | None:
    """Put one flipped bit right; True where there was one, None for a sound block, False where it is worse."""
    block = file.bytes_at(at, length)
    if not 8 < length <= LONGEST_BLOCK or len(block) < length:
        return False
    computed = lookup3(block[:-4])
    if computed == _stored(block):
        return None
    if (computed ^ _stored(block)).bit_count() == 1:  # the bit is in the checksum
        file.patch(at + length - 4, computed.to_bytes(4, "little"))
        return True
    bit = _search(file, block[:-4], _stored(block))
    if bit is None:
        return False
    _flip(file, at, bit)
    return True


def _search(file: MendedFile, block: bytes, stored: int) -> int | None:
    """The flipped bit of a block; None for none, and where too much was searched in vain already."""
    cost = 8 * len(block) ** 2  # a checksum of the whole block for each of its bits
    if file.searched_bytes + cost > MOST_SEARCHED_BYTES:
        return None
    bit = flipped_bit(block, stored)
    if bit is None:
        file.searched_bytes += cost
    return bit


def _flip(file: MendedFile, at: int, bit: int) -> None:
    place = at + bit // 8
    file.patch(place, bytes([file.bytes_at(place, 1)[0] ^ 1 << bit % 8]))
