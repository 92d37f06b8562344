"""Check one block of HDF5 metadata by the checksum at its end, and correct one flipped bit."""

from __future__ import annotations

from eimi_lab.dataset.repair.checksums import flipped_bit, lookup3
from eimi_lab.dataset.repair.mended_file import MendedFile

LONGEST_BLOCK = 1 << 14
MOST_SEARCHED_BYTES = 1 << 30
"""Limit of the work of unsuccessful searches for flipped bits in one file, as the number of hashed bytes.

The search for a single flipped bit stays far below this limit. For a truncated file the search would take hours.
"""


def is_sound(file: MendedFile, at: int, length: int) -> bool:
    """Return whether the checksum of a block of HDF5 metadata is correct.

    The block begins at the byte `at` of the file, and has `length` bytes including the checksum.
    """
    block = file.bytes_at(at, length)
    return 8 < length <= LONGEST_BLOCK and len(block) == length and lookup3(block[:-4]) == _stored(block)


def _stored(block: bytes) -> int:
    return int.from_bytes(block[-4:], "little")


def mend_block(file: MendedFile, at: int, length: int) -> bool | None:
    """Correct one flipped bit in a block of HDF5 metadata (descriptions of groups and arrays).

    Parameters
    ----------
    file : MendedFile
        The file.
    at : int
        Position of the block in the file, bytes.
    length : int
        Length of the block including its checksum, bytes.

    Returns
    -------
    bool or None
        True if one bit was corrected, False if the block cannot be corrected, None if the checksum is correct.
    """
    block = file.bytes_at(at, length)
    if not 8 < length <= LONGEST_BLOCK or len(block) < length:
        return False
    computed = lookup3(block[:-4])
    if computed == _stored(block):
        return None
    if (computed ^ _stored(block)).bit_count() == 1:  # the flipped bit is in the checksum itself
        file.patch(at + length - 4, computed.to_bytes(4, "little"))
        return True
    bit = flipped_bit_within_budget(file, block[:-4], _stored(block))
    if bit is None:
        return False
    file.flip(at, bit)
    return True


def flipped_bit_within_budget(file: MendedFile, block: bytes, stored: int) -> int | None:
    """Search for the one flipped bit in a block of HDF5 metadata whose checksum is wrong.

    Parameters
    ----------
    file : MendedFile
        The file.
    block : bytes
        The block without its checksum.
    stored : int
        The checksum in the file.

    Returns
    -------
    int or None
        Index of the bit, from the lowest bit of the first byte; None if no bit is found in the allowed time.
    """
    cost = 8 * len(block) ** 2  # one checksum of the whole block for each of its bits
    if file.searched_bytes + cost > MOST_SEARCHED_BYTES:
        return None
    bit = flipped_bit(block, stored)
    if bit is None:
        file.searched_bytes += cost
    return bit
