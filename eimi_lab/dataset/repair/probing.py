"""Check whether a file that was never closed can be read at all.

If the metadata of such a file are damaged, HDF5 assumes that a writer is still changing them and retries without end
(observed with HDF5 2.0). The check therefore runs in another process with a limit of time.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import h5py

WITHIN_S = 15.0


def why_unreadable(path: Path) -> str:
    """Return why an unclosed file cannot be read; an empty text if its metadata and small tables are readable."""
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-m", __name__, str(path)], capture_output=True, text=True, timeout=WITHIN_S
        )
    except subprocess.TimeoutExpired:
        return f"its metadata could not be read within {WITHIN_S:g} s"
    return "" if done.returncode == 0 else done.stderr.strip().rpartition("\n")[2] or "reading it ended another process"


def read_all_but_frames(path: str | Path) -> None:
    """Read every small table and the position of every frame; may raise any error of h5py, or never return."""

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
