"""One block of metadata, which ends with its checksum: whether it is sound, and the bit that was flipped in it."""

from __future__ import annotations

from eimi_lab.dataset.repair.checksums import flipped_bit, lookup3
from eimi_lab.dataset.repair.mended_file import MendedFile

LONGEST_BLOCK = 1 << 14
MOST_SEARCHED_BYTES = 1 << 30
"""Of what is hashed in vain in one file: one with a flipped bit needs little of it, one cut in two would need hours."""


def is_sound(file: MendedFile, at: int, length: int) -> bool:
    block = file.bytes_at(at, length)
    return 8 < length <= LONGEST_BLOCK and len(block) == length and lookup3(block[:-4]) == _stored(block)


def _stored(block: bytes) -> int:
    return int.from_bytes(block[-4:], "little")


def mend_block(file: MendedFile, at: int, length: int) -> bool | None:
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
    bit = flipped_bit_within_budget(file, block[:-4], _stored(block))
    if bit is None:
        return False
    file.flip(at, bit)
    return True


def flipped_bit_within_budget(file: MendedFile, block: bytes, stored: int) -> int | None:
    """The flipped bit of a block; None for none, and where too much was searched in vain already."""
    cost = 8 * len(block) ** 2  # a checksum of the whole block for each of its bits
    if file.searched_bytes + cost > MOST_SEARCHED_BYTES:
        return None
    bit = flipped_bit(block, stored)
    if bit is None:
        file.searched_bytes += cost
    return bit
