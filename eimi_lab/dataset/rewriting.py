"""Changing a finished dataset: on a copy that then takes the file's place, so that no crash harms the frames."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from eimi_lab.errors import InputError
from eimi_lab.outputs import whole_file


@contextmanager
def rewritten(path: Path) -> Iterator[h5py.Group]:
    """The entry, to write to; what was written is kept only when the block ends well.

    Raises InputError for a file that is still being written or whose writer crashed.
    """
    with whole_file(path, force=True) as copy:
        shutil.copyfile(path, copy)
        try:
            file = h5py.File(copy, "r+", libver="latest")
        except OSError as error:
            raise InputError(f"{path}: is still being written, or its writer crashed; `eimi recover` helps") from error
        with file:
            yield file["entry"]
