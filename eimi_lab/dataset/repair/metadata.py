"""Correct single flipped bits in the metadata of an HDF5 file by means of the checksums of the metadata.

Blocks are located by the four bytes of their signature. Their length is in their first bytes or in their header (HDF5
File Format Specification 3.0, sections II to IV and VII).
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from eimi_lab.dataset.repair.blocks import LONGEST_BLOCK, flipped_bit_within_budget, is_sound, mend_block
from eimi_lab.dataset.repair.checksums import lookup3
from eimi_lab.dataset.repair.mended_file import MendedFile

CONTINUATION = 0x10
OBJECT_HEADER = re.compile(b"OHDR")
_OTHERS = re.compile(b"EAHD|EAIB|EADB|FRHP|FHDB|BTHD|BTLF")


def mend_metadata(file: MendedFile) -> int:
    """Correct one flipped bit in each damaged block of HDF5 metadata, and return the number of corrected blocks.

    Metadata are HDF5's descriptions of groups and arrays.
    """
    mended = 0
    for any_bit in (False, True):  # usually the signature itself is sound, and the first search is short
        for at in file.find(_with_one_wrong(OBJECT_HEADER) if any_bit else OBJECT_HEADER):
            if _nearest_signature(file.bytes_at(at, 4), OBJECT_HEADER):
                mended += _mend_header(file, at)
        for place in file.find(_with_one_wrong(_OTHERS) if any_bit else _OTHERS):
            signature = _nearest_signature(file.bytes_at(place, 4), _OTHERS)
            if signature:
                mended += _mend_signed(file, place, signature)
        if mended:
            break
    return mended


def _with_one_wrong(pattern: re.Pattern[bytes]) -> re.Pattern[bytes]:
    names = pattern.pattern.split(b"|")
    return re.compile(b"|".join(name[:k] + b"." + name[k + 1 :] for name in names for k in range(4)), re.DOTALL)


def _nearest_signature(content: bytes, pattern: re.Pattern[bytes]) -> bytes | None:
    """Return the block signature (4 bytes) that differs by at most one bit from `content`; None if there is none."""
    for name in pattern.pattern.split(b"|"):
        if len(content) == 4 and (int.from_bytes(content, "little") ^ int.from_bytes(name, "little")).bit_count() <= 1:
            return name
    return None


def _mend_header(file: MendedFile, at: int) -> int:
    """Correct the object header at the position `at`, and return the number of corrected blocks.

    An object header is HDF5's description of one group or array.
    """
    lengths = {_header_length(file.bytes_at(at, 64))}
    head = file.bytes_at(at, 64)
    for bit in range(32, 8 * min(len(head), 34)):  # the flipped bit may be in the field that holds the length
        changed = bytearray(head)
        changed[bit // 8] ^= 1 << bit % 8
        lengths.add(_header_length(bytes(changed)))
    mended, whole = _mend_any(file, at, sorted(lengths))
    if not whole:
        return 0
    header = file.bytes_at(at, whole)
    first = _header_length(header) - 4 - int.from_bytes(header[_length_at(header) :][: 1 << (header[5] & 3)], "little")
    waiting, visited = list(_continuations(header[first:-4], header[5])), set()
    while waiting:
        address, length = waiting.pop()
        if (address, length) in visited:  # the blocks form a loop
            continue
        visited.add((address, length))
        outcome = mend_block(file, address, length)
        mended += outcome is True
        if outcome is not False:
            waiting += _continuations(file.bytes_at(address, length)[4:-4], header[5])
    return mended


def _mend_any(file: MendedFile, at: int, lengths: list[int]) -> tuple[int, int]:
    """Correct one flipped bit in the block at the position `at`, whose length is one of several possible lengths.

    Returns the number of corrected bits (0 or 1) and the length with a correct checksum (0 if there is none).
    """
    for length in lengths:
        if is_sound(file, at, length):
            return 0, length
    for length in lengths:
        if mend_block(file, at, length):
            return 1, length
    return 0, 0


def _header_length(head: bytes) -> int:
    """Return the length of an object header (description of a group or array) in bytes, with its checksum.

    The result is 0 for other content (HDF5 File Format Specification 3.0, section IV.A.1.b).
    """
    if len(head) < 34 or head[4] != 2:
        return 0
    at, width = _length_at(head), 1 << (head[5] & 3)
    return at + width + int.from_bytes(head[at : at + width], "little") + 4


def _length_at(head: bytes) -> int:
    """Return the position (bytes) at which an object header (description of a group or array) contains its length."""
    return 6 + (16 if head[5] & 0x20 else 0) + (4 if head[5] & 0x10 else 0)


def _continuations(messages: bytes, flags: int) -> Iterator[tuple[int, int]]:
    """Yield the position and the length (bytes) of each block that continues an object header (description of a group).

    ``messages`` contains the bytes of all messages in the header, and ``flags`` the byte with its flags.
    """
    at, prefix = 0, 6 if flags & 4 else 4
    while at + prefix <= len(messages):
        length = int.from_bytes(messages[at + 1 : at + 3], "little")
        if messages[at] == CONTINUATION:
            body = messages[at + prefix : at + prefix + 16]
            yield int.from_bytes(body[:8], "little"), int.from_bytes(body[8:], "little")
        at += prefix + length


def _mend_signed(file: MendedFile, at: int, signature: bytes) -> int:
    if signature == b"FHDB":
        return _mend_heap(file, at)
    return _mend_any(file, at, _block_lengths(file, at, signature))[0]


def _mend_heap(file: MendedFile, at: int) -> int:
    """Correct one flipped bit in the block at `at`, which holds names of links; return the number of corrected bits.

    The block is part of a heap. Its checksum is before the names (HDF5 File Format Specification 3.0, section III.G).
    """
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
    bit = flipped_bit_within_budget(file, block, stored)
    if bit is not None:
        file.flip(at, bit)
    return bit is not None


def _block_lengths(file: MendedFile, at: int, signature: bytes) -> list[int]:
    """Return the possible lengths (bytes) of the block of HDF5 metadata at `at`; empty if they are unknown.

    See HDF5 File Format Specification 3.0, sections III.A.2, III.G and VII.
    """
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
