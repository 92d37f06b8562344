"""Check whether HDF5 can read a file that was never closed.

If the metadata of an unclosed file are damaged, HDF5 assumes that a writer is changing the metadata, and reads the
metadata again and again without end (observed with HDF5 2.0). Therefore the check runs in a second process with limited
time.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import h5py

WITHIN_S = 15.0


def why_unreadable(path: Path) -> str:
    """Return the reason why an unclosed file cannot be read; an empty text if HDF5 can read its metadata and tables."""
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-m", __name__, str(path)], capture_output=True, text=True, timeout=WITHIN_S
        )
    except subprocess.TimeoutExpired:
        return f"its metadata could not be read within {WITHIN_S:g} s"
    if done.returncode == 0:
        return ""
    return done.stderr.strip().rpartition("\n")[2] or "HDF5 crashed when it read the file"


def read_all_but_frames(path: str | Path) -> None:
    """Read every table of a file, and the position of every frame in it.

    For a damaged file, h5py may raise any error, or the function may never return.
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
    read_all_but_frames(sys.argv[1])
