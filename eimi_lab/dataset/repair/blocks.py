"""Check one block of HDF5 metadata by the checksum at its end, and correct one flipped bit."""

from __future__ import annotations

from eimi_lab.dataset.repair.checksums import flipped_bit, lookup3
from eimi_lab.dataset.repair.mended_file import MendedFile

LONGEST_BLOCK = 1 << 14
MOST_SEARCHED_BYTES = 1 << 30
"""Largest number of bytes that are hashed without success in one file.

A file with a flipped bit needs few of them; a truncated file would need hours.
"""


def is_sound(file: MendedFile, at: int, length: int) -> bool:
    """Return whether the checksum of the block of `length` bytes at position `at` is correct."""
    block = file.bytes_at(at, length)
    return 8 < length <= LONGEST_BLOCK and len(block) == length and lookup3(block[:-4]) == _stored(block)


def _stored(block: bytes) -> int:
    return int.from_bytes(block[-4:], "little")


def mend_block(file: MendedFile, at: int, length: int) -> bool | None:
    """Correct one flipped bit of a block.

    Parameters
    ----------
    file : MendedFile
        The file.
    at : int
        Position of the block in the file, bytes.
    length : int
        Length of the block with its checksum, bytes.

    Returns
    -------
    bool or None
        True if a bit was corrected, None if the block was sound, False if no single bit explains the checksum.
    """
    block = file.bytes_at(at, length)
    if not 8 < length <= LONGEST_BLOCK or len(block) < length:
        return False
    computed = lookup3(block[:-4])
    if computed == _stored(block):
        return None
    if (computed ^ _stored(block)).bit_count() == 1:  # the bit is in the checksum
        file.patch(at + length - 4, computed.to_bytes(4, "little"))
        return True
    bit = flipped_bit_within_budget(file, block[:-4], _stored(block))
    if bit is None:
        return False
    file.flip(at, bit)
    return True


def flipped_bit_within_budget(file: MendedFile, block: bytes, stored: int) -> int | None:
    """Return the index of the flipped bit of a block, or None if no single bit explains the checksum.

    The function also returns None, without a search, if the search would exceed `MOST_SEARCHED_BYTES` for the file.
    """
    cost = 8 * len(block) ** 2  # one checksum of the whole block for each of its bits
    if file.searched_bytes + cost > MOST_SEARCHED_BYTES:
        return None
    bit = flipped_bit(block, stored)
    if bit is None:
        file.searched_bytes += cost
    return bit
