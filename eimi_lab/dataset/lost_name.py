"""Notice that another program changed, moved, deleted or replaced an open dataset, and copy it to another name."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path

from eimi_lab.dataset.storage_failure import StorageFailed
from eimi_lab.process.errors import InputError
from eimi_lab.process.outputs import whole_file
from eimi_lab.process.writer_lock import WriterLock

COPY_BYTES = 1 << 20
HEAD_BYTES = 4096
"""Number of bytes at the beginning of a dataset that are compared, to notice that another program wrote into it."""


def head_of(descriptor: int) -> bytes:
    """Return the first bytes of an open file, given by its descriptor. The position in the file is restored."""
    place = os.lseek(descriptor, 0, os.SEEK_CUR)  # HDF5 may continue at this position
    try:
        os.lseek(descriptor, 0, os.SEEK_SET)
        return os.read(descriptor, HEAD_BYTES)
    finally:
        os.lseek(descriptor, place, os.SEEK_SET)


def fate_of(path: Path, descriptor: int) -> str:
    """Return what another program did to an open file, such as "was moved".

    The text is empty if ``path`` still leads to the file.
    """
    try:
        open_file = os.fstat(descriptor)
    except OSError:  # the file is closed already
        return ""
    try:
        file_at_path = os.stat(path)
    except OSError:
        return "was moved" if open_file.st_nlink else "was deleted"
    if os.path.samestat(open_file, file_at_path):
        return ""
    return "was moved, and another file now has the name of the dataset" if open_file.st_nlink else "was replaced"


def copy_beside(path: Path, source: int, fate: str, beat: Callable[[], None]) -> tuple[Path, WriterLock]:
    """Copy an open file to the folder of ``path`` or, if this fails, to the folder for temporary files.

    Parameters
    ----------
    path
        The path that the file had.
    source
        File descriptor of the open file.
    fate
        What happened to the file, such as "was deleted", for a message.
    beat
        Function that is called repeatedly during the copying.

    Returns
    -------
    path, lock
        The path of the copy, and the lock that keeps other programs from writing to the copy.

    Raises
    ------
    StorageFailed
        If the file can be copied to neither folder.
    """
    reasons = []
    for folder in (path.parent, Path(tempfile.gettempdir())):
        try:
            folder.mkdir(parents=True, exist_ok=True)  # the whole folder may have been moved
            name = next(name for name in _names_beside(folder / path.name) if not name.exists())
            lock = WriterLock(name)
        except (OSError, InputError) as error:
            reasons.append(str(error))
            continue
        try:
            with whole_file(name, force=False) as temporary, temporary.open("wb") as copy:
                os.lseek(source, 0, os.SEEK_SET)
                while piece := os.read(source, COPY_BYTES):
                    copy.write(piece)
                    beat()
            return name, lock
        except (OSError, InputError) as error:
            reasons.append(str(error))
            lock.release()
    raise StorageFailed(f"{path}: {fate} during the run, and no copy can be made: {'; '.join(reasons)}")


def _names_beside(path: Path) -> Iterator[Path]:
    yield path.with_stem(f"{path.stem}-continued")
    yield from (path.with_stem(f"{path.stem}-continued-{number}") for number in count(2))
