"""Change a finished dataset so that a crash cannot damage the file: a copy is changed, and then replaces the file."""

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
from eimi_lab.process.replacing import patiently

HEADERS_BYTES = 1 << 14
"""Bytes that are reserved for the structures that HDF5 adds to a file."""


@contextmanager
def rewritten(path: Path, content_bytes: int = 0) -> Iterator[h5py.Group]:
    """Open a copy of a dataset for changes in a ``with`` statement, and yield the copy's group `entry`.

    At the end, the copy replaces the dataset. After an error, the dataset stays unchanged.

    Parameters
    ----------
    path
        The dataset.
    content_bytes
        Number of bytes to be written, for which space is reserved.

    Raises
    ------
    InputError
        If the file is still being written, or if its writer crashed.
    OSError
        If the disk does not have enough free space.
    """
    with whole_file(path, force=True) as copy:
        shutil.copyfile(path, copy)
        _make_room(copy, path.stat().st_size + content_bytes + HEADERS_BYTES)
        try:
            file = patiently(lambda: h5py.File(copy, "r+", libver=WRITTEN_AS))
        except OSError as error:
            raise InputError(
                f"{path}: is still being written, or its writer crashed; wait for the end of the run, or make a copy "
                "with `eimi recover`"
            ) from error
        with file:
            yield file["entry"]


def _make_room(file: Path, size: int) -> None:
    """Reserve space on the disk for a file of ``size`` bytes, if the operating system can do so."""
    # HDF5 may crash the program on a full disk; it removes unused bytes later
    if hasattr(os, "posix_fallocate"):
        with patiently(lambda: file.open("r+b")) as opened:
            os.posix_fallocate(opened.fileno(), 0, size)
