"""Check whether HDF5 can read a file that was never closed.

HDF5 2.0 may read damaged metadata without end. Therefore the check runs in a second process with limited time.
"""

from __future__ import annotations

import sys
from pathlib import Path

import h5py

from eimi_lab.process.limits import child_arguments, obey_processor_limit, run_limited

WITHIN_S = 15.0
"""Limit of the processor time, s. Elapsed time would be unsuitable, because it may be long if the computer is busy."""


def why_unreadable(path: Path) -> str:
    """Return the reason why an unclosed file cannot be read; an empty text if HDF5 can read its metadata and tables.

    Raises
    ------
    InputError
        If the check exceeded the limit of processor time, or if its process was killed or crashed.
    """
    done = run_limited(path, [sys.executable, "-P", "-m", __name__, str(path)], WITHIN_S)
    if done.returncode == 0:
        return ""
    return done.stderr.decode("utf-8", "replace").strip().rpartition("\n")[2] or "HDF5 gave no reason"


def read_all_but_frames(path: str | Path) -> None:
    """Read every table of a file, and the positions of all frames, to check whether HDF5 can read the file.

    For a damaged file, h5py may raise any error, or this function may never return.
    """

    def read(name: str, item: h5py.Group | h5py.Dataset) -> None:
        if not isinstance(item, h5py.Dataset):
            return
        if item.chunks:
            item.id.get_num_chunks()
        if item.ndim < 3:
            item[()]

    with h5py.File(path, "r", libver="latest", swmr=True) as file:
        file.visititems(read)


if __name__ == "__main__":
    checked, limit_s = child_arguments(2)
    obey_processor_limit(limit_s)
    read_all_but_frames(checked)
