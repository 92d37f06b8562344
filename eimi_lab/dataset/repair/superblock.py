"""Recognise a damaged HDF5 file, and correct the superblock (first block) of a file that was never closed."""

from __future__ import annotations

from eimi_lab.dataset.repair.blocks import mend_block
from eimi_lab.dataset.repair.checksums import lookup3
from eimi_lab.dataset.repair.mended_file import MendedFile
from eimi_lab.dataset.repair.metadata import OBJECT_HEADER

SUPERBLOCK_BYTES = 48
SIGNATURE = b"\x89HDF\r\n\x1a\n"
FLAGS_AT, END_AT = 11, 28


def is_hdf5(file: MendedFile) -> bool:
    """Return whether a file is an HDF5 file, even if it is damaged."""
    beginning = file.bytes_at(0, len(SIGNATURE))
    sound_bytes = sum(byte == right for byte, right in zip(beginning, SIGNATURE, strict=False))
    return file.size >= SUPERBLOCK_BYTES and (
        sound_bytes >= len(SIGNATURE) / 2 or any(True for _ in file.find(OBJECT_HEADER))
    )


def close_superblock(file: MendedFile) -> None:
    """Correct the superblock of a file of version 3 and mark the file as closed, as HDF5's tool h5clear does."""
    file.patch(0, SIGNATURE + b"\x03\x08\x08")
    mend_block(file, 0, SUPERBLOCK_BYTES)
    head = bytearray(file.bytes_at(0, SUPERBLOCK_BYTES - 4))
    head[FLAGS_AT] = 0
    head[END_AT : END_AT + 8] = file.size.to_bytes(8, "little")
    file.patch(0, bytes(head) + lookup3(bytes(head)).to_bytes(4, "little"))
