"""The tracking programs whose files can be imported, with their names on the command line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from eimi_lab.dataset.tracked.c3d import read_c3d
from eimi_lab.dataset.tracked.deeplabcut import read_deeplabcut
from eimi_lab.dataset.tracked.dice import read_dice
from eimi_lab.dataset.tracked.dltdv import read_dltdv
from eimi_lab.dataset.tracked.mudic import read_mudic
from eimi_lab.dataset.tracked.ncorr import read_ncorr
from eimi_lab.dataset.tracked.tracker import read_tracker
from eimi_lab.dataset.tracked.tracks import Tracks
from eimi_lab.process.errors import InputError

FORMATS: dict[str, Callable[[Path], Tracks]] = {
    "dice": read_dice,
    "ncorr": read_ncorr,
    "mudic": read_mudic,
    "dltdv": read_dltdv,
    "tracker": read_tracker,
    "deeplabcut": read_deeplabcut,
    "c3d": read_c3d,
}


def reader_of(tool: str) -> Callable[[Path], Tracks]:
    """Return the function that reads the files of a tracking program. Raises InputError for an unknown program."""
    if tool not in FORMATS:
        raise InputError(f"--format {tool}: should be one of {', '.join(FORMATS)}")
    return FORMATS[tool]
