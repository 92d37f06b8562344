"""Safe change of a finished dataset: a copy is changed and then replaces the file, so no crash can harm the frames."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from eimi_lab.dataset.layout import WRITTEN_AS
from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import whole_file

HEADERS_BYTES = 1 << 14
"""Room for HDF5's own structures, some kB for each object."""


@contextmanager
def rewritten(path: Path, content_bytes: int = 0) -> Iterator[h5py.Group]:
    """Yield the group `entry` of a dataset for changes, which are kept only if the block ends without an error.

    Parameters
    ----------
    path
        The dataset.
    content_bytes
        Size of the numbers that will be written. The room for them is reserved, because HDF5 may crash the program if
        the disk becomes full while it writes.

    Raises
    ------
    InputError
        If the file is still being written, or if its writer crashed.
    OSError
        If the disk has not enough room.
    """
    with whole_file(path, force=True) as copy:
        shutil.copyfile(path, copy)
        _make_room(copy, path.stat().st_size + content_bytes + HEADERS_BYTES)
        try:
            file = h5py.File(copy, "r+", libver=WRITTEN_AS)
        except OSError as error:
            raise InputError(f"{path}: is still being written, or its writer crashed; `eimi recover` helps") from error
        with file:
            yield file["entry"]


def _make_room(file: Path, size: int) -> None:
    """Lengthen a file to ``size`` bytes if the system can; HDF5 cuts off the bytes that it does not use."""
    if hasattr(os, "posix_fallocate"):
        with file.open("r+b") as opened:
            os.posix_fallocate(opened.fileno(), 0, size)
