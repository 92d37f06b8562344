"""Open an HDF5 file for reading, even if a run is writing it or its writer crashed."""

from __future__ import annotations

from pathlib import Path

import h5py

from eimi_lab.dataset.repair.mended_file import MendedFile
from eimi_lab.dataset.repair.probing import why_unreadable
from eimi_lab.dataset.repair.superblock import close_superblock
from eimi_lab.process.errors import InputError
from eimi_lab.process.replacing import patiently
from eimi_lab.process.writer_lock import is_being_written

_NOT_HDF5 = "is not an HDF5 file; `eimi import` makes a dataset from images or points"
# Messages for files that a user may confuse with a dataset, by the ending of the name.
_CONFUSED_WITH_DATASET = {
    ".json": "is a JSON file, not a dataset; `eimi acquire` or `eimi import` makes a dataset; a fits.json belongs "
    "to --fit",
    ".toml": "is a TOML file, not a dataset; `eimi acquire` or `eimi import` makes a dataset",
    ".csv": "is a table; `eimi import` makes a dataset from a table and the pictures that it lists",
}


def open_file(path: Path) -> tuple[h5py.File, bool]:
    """Open an HDF5 file for reading, also during a run and after a crash.

    Returns
    -------
    file, finished
        The open file, and whether its writer closed the file: False during a run and after a crash.

    Raises
    ------
    InputError
        If the file does not exist, cannot be read, is damaged or is not an HDF5 file.
    """
    if path.is_dir():
        raise InputError(f"{path}: is a folder; a dataset is a file, which `eimi import` makes from a folder of images")
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        patiently(lambda: path.open("rb")).close()  # HDF5 takes a file that it cannot open for no HDF5 file
        is_hdf5 = h5py.is_hdf5(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from error
    if not is_hdf5:
        raise InputError(f"{path}: {_not_a_dataset(path)}")
    try:
        return h5py.File(path, "r"), True
    except OSError as error:
        reason = str(error)
    if _has_a_writer(path):
        if is_being_written(path):
            if reason := why_unreadable(path):
                raise InputError(f"{path}: is a damaged HDF5 file ({reason})")
            return h5py.File(path, "r", libver="latest", swmr=True), False
        crashed = MendedFile(path)
        close_superblock(crashed)
        try:
            return h5py.File(crashed, "r"), False
        except OSError as error:
            reason = str(error)
    raise InputError(f"{path}: is a damaged HDF5 file ({reason}); `eimi recover` makes a copy of what is readable")


def _not_a_dataset(path: Path) -> str:
    """Return a text about the kind of a file that is not a dataset, and how to make a dataset."""
    from eimi_lab.dataset.videos import ENDINGS as VIDEOS  # OpenCV loads slowly
    from eimi_lab.vision.image_files import ENDINGS as IMAGES

    ending = path.suffix.lower()
    if ending in IMAGES:
        return "is a picture; `eimi import` makes a dataset from pictures"
    if ending in VIDEOS:
        return "is a video; `eimi import` makes a dataset from a video"
    return _CONFUSED_WITH_DATASET.get(ending, _NOT_HDF5)


# The superblock (first block) has the mark in byte 11 and its version in byte 8. Only version 3 has the mark (HDF5 File
# Format Specification 3.0, section II.A).
def _has_a_writer(path: Path) -> bool:
    """Return whether an HDF5 file is marked as open for writing, by a running or a crashed program."""
    with path.open("rb") as raw:
        superblock = raw.read(12)
    return len(superblock) == 12 and superblock[8] == 3 and superblock[11] != 0
