"""The first block of an HDF5 file: whether it is one, and a superblock that says that the file was closed."""

from __future__ import annotations

from eimi_lab.dataset.repair.blocks import mend_block
from eimi_lab.dataset.repair.checksums import lookup3
from eimi_lab.dataset.repair.mended_file import MendedFile
from eimi_lab.dataset.repair.metadata import OBJECT_HEADER

SUPERBLOCK_BYTES = 48
SIGNATURE = b"\x89HDF\r\n\x1a\n"
FLAGS_AT, END_AT = 11, 28


def is_hdf5(file: MendedFile) -> bool:
    """Whether it was an HDF5 file once: half of its signature or a header of an object is left."""
    sound = sum(found == meant for found, meant in zip(file.bytes_at(0, len(SIGNATURE)), SIGNATURE, strict=False))
    return file.size >= SUPERBLOCK_BYTES and (
        sound >= len(SIGNATURE) / 2 or any(True for _ in file.find(OBJECT_HEADER))
    )


def close_superblock(file: MendedFile) -> None:
    """Let a file that was never closed read as a closed one, as HDF5's own h5clear does, and mend its superblock.

    Nothing is done to other versions of the superblock, which nobody writes to in the mode that this suite uses.
    """
    file.patch(0, SIGNATURE + b"\x03\x08\x08")
    mend_block(file, 0, SUPERBLOCK_BYTES)
    head = bytearray(file.bytes_at(0, SUPERBLOCK_BYTES - 4))
    head[FLAGS_AT] = 0
    head[END_AT : END_AT + 8] = file.size.to_bytes(8, "little")
    file.patch(0, bytes(head) + lookup3(bytes(head)).to_bytes(4, "little"))
