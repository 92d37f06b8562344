"""Read C3D files of motion capture (c3d.org) with the library ezc3d (github.com/pyomeca/ezc3d).

A C3D file contains markers in three dimensions. A residual below 0 means that the marker was not found.
"""

from __future__ import annotations

import pickle
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from eimi_lab.dataset.tracked.numbers_table import refused
from eimi_lab.dataset.tracked.tracks import Tracks
from eimi_lab.process.errors import InputError
from eimi_lab.process.limits import (
    SHARE_OF_FREE,
    child_arguments,
    free_memory_bytes,
    limit_memory,
    obey_processor_limit,
    run_limited,
)

OWN_BYTES = 2 << 30
"""Address space that Python and its libraries need before a file is read, in bytes."""
UNPACKED_PER_BYTE = 64
"""Memory (bytes) that the library ezc3d may use for each byte of a file. An undamaged file needs at most about 24."""
_UNITS = {"mm": "mm", "cm": "cm", "m": "m", "in": "in", "millimeters": "mm", "meters": "m"}


READ_WITHIN_S, BYTES_PER_S = 10.0, 1e6


def read_c3d(path: Path) -> Tracks:
    """Return the markers of a C3D file as tracks (positions of points in frames).

    A second process reads the file, because a damaged file can crash ezc3d. Raises InputError if ezc3d is not
    installed, or if the file cannot be read.
    """
    if find_spec("ezc3d") is None:
        raise InputError(f"{path}: C3D needs another package: pip install 'eimi-lab[c3d]'")
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    within_s = READ_WITHIN_S + path.stat().st_size / BYTES_PER_S
    done = run_limited(path, [sys.executable, "-P", "-m", __name__, str(path)], within_s)
    if done.returncode:
        raise InputError(done.stderr.decode("utf-8", "replace").strip().rpartition("\n")[2])
    tracks: Tracks = pickle.loads(done.stdout)  # written by `_main`
    return tracks


def _main(path: Path, within_s: str) -> None:
    """Read a C3D file in this process, with limited memory and processor time (s), and print a pickled `Tracks`."""
    obey_processor_limit(within_s)
    bound_memory(path.stat().st_size)
    try:
        tracks = read_in_this_process(path)
    except MemoryError:
        sys.exit(
            f"{path}: is damaged or too large: it needs more than a quarter of the free memory, or more memory than "
            f"{UNPACKED_PER_BYTE} times the size of the file"
        )
    except InputError as error:
        sys.exit(str(error))
    sys.stdout.buffer.write(pickle.dumps(tracks))


def bound_memory(file_bytes: int) -> None:
    """Limit the memory of this process before it reads a C3D file of ``file_bytes`` bytes, which may be damaged."""
    limit_memory(OWN_BYTES + min(free_memory_bytes() // SHARE_OF_FREE, UNPACKED_PER_BYTE * file_bytes))


def read_in_this_process(path: Path) -> Tracks:
    """Return the markers of a C3D file as tracks (positions in frames); a damaged file may crash this process.

    Raises InputError if the file is wrong, and MemoryError if reading takes more memory than allowed.
    """
    import ezc3d

    try:
        file: Any = ezc3d.c3d(str(path))
        points = np.asarray(file["data"]["points"], dtype=np.float64)[:3]  # (3 coordinates, n markers, k frames)
        parameters, header = file["parameters"]["POINT"], file["header"]["points"]
        labels = [str(label) for label in parameters["LABELS"]["value"]]
        units = [str(unit).strip().lower() for unit in parameters["UNITS"]["value"]] if "UNITS" in parameters else []
        residuals = np.asarray(file["data"]["meta_points"]["residuals"], dtype=np.float64).reshape(-1, points.shape[2])
    except MemoryError:
        raise
    except Exception as error:  # ezc3d may raise nearly any error on a damaged file
        raise refused(path, "motion capture (C3D)", " ".join(str(error).split())[:120]) from error
    count = points.shape[1]
    if not count or not points.shape[2]:
        raise InputError(f"{path}: holds no markers")
    places = points.transpose(2, 1, 0).copy()
    if residuals.shape[0] == count:
        places[residuals.T < 0.0] = np.nan
    frames = (
        np.arange(places.shape[0]) + int(header["first_frame"]) + 1
    )  # ezc3d counts the first frame of the header from 0
    rate = float(header["frame_rate"])
    return Tracks(
        names=tuple([*labels, *(f"marker {k + 1}" for k in range(len(labels), count))][:count]),
        frames=frames,
        places=places,
        unit=_UNITS.get(units[0]) if units else None,
        times_s=(frames - frames[0]) / rate if rate > 0 else None,
    )


if __name__ == "__main__":
    source, limit_s = child_arguments(2)
    _main(Path(source), limit_s)
