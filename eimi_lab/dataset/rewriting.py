"""Changing a finished dataset: on a copy that then takes the file's place, so that no crash harms the frames."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import whole_file

HEADERS_BYTES = 1 << 14
"""For what HDF5 writes around the numbers: some kB for each object."""


@contextmanager
def rewritten(path: Path, content_bytes: int = 0) -> Iterator[h5py.Group]:
    """The entry, to write to; what was written is kept only when the block ends well.

    content_bytes: of the numbers to be written. There must be room for them: HDF5 takes the program down with it when
    the disk is full while it writes.

    Raises InputError for a file that is still being written or whose writer crashed, OSError where there is no room.
    """
    with whole_file(path, force=True) as copy:
        shutil.copyfile(path, copy)
        _make_room(copy, path.stat().st_size + content_bytes + HEADERS_BYTES)
        try:
            file = h5py.File(copy, "r+", libver="latest")
        except OSError as error:
            raise InputError(f"{path}: is still being written, or its writer crashed; `eimi recover` helps") from error
        with file:
            yield file["entry"]


def _make_room(file: Path, size: int) -> None:
    """Lengthen a file to `size` bytes, where the system can; HDF5 cuts off what it does not use."""
    if hasattr(os, "posix_fallocate"):
        with file.open("r+b") as opened:
            os.posix_fallocate(opened.fileno(), 0, size)
