"""Whether a file that was never closed can be read at all.

Where its metadata are damaged, HDF5 takes that for the work of a writer in progress and tries again without end (seen
with HDF5 2.0). So another process goes first, with a time to finish in.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import h5py

WITHIN_S = 15.0


def why_unreadable(path: Path) -> str:
    """What is wrong with an unclosed file, in a few words; empty where its metadata and small tables can be read."""
    try:
        done = subprocess.run(
            [sys.executable, "-P", "-m", __name__, str(path)], capture_output=True, text=True, timeout=WITHIN_S
        )
    except subprocess.TimeoutExpired:
        return f"its metadata could not be read within {WITHIN_S:g} s"
    return "" if done.returncode == 0 else done.stderr.strip().rpartition("\n")[2] or "reading it ended another process"


def read_all_but_frames(path: str | Path) -> None:
    """Read every small table, and where every frame lies. Raises what h5py raises; may never end."""

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
