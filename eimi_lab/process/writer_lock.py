"""Allow one writer at a time for each file. The operating system releases the lock when its holder ends.

The lock (flock(2), or LockFileEx on Windows) is taken on a separate file, such as `.run.h5.lock` beside `run.h5`.
"""

from __future__ import annotations

import os
import platform
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from filelock import lock_descriptor, unlock_descriptor

from eimi_lab.process.errors import InputError, tell
from eimi_lab.process.paths import followed
from eimi_lab.process.replacing import patiently, remove

# The data file itself cannot be locked: HDF5 locks and unlocks it at any time, and replacing the file loses the lock.
# A lock file that is a link is never followed, because another user may have put it there.
_NO_LINK = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
"""Flags of open(2): fail for a symbolic link, and do not wait for the other end of a pipe."""


@dataclass
class _Held:
    # A lock that this process holds. ``descriptor`` is the open lock file, or -1 if the file system does not support
    # locks. ``owner`` is the process number and the thread number of the owner, which has taken the lock ``times``
    # times.

    descriptor: int
    owner: tuple[int, int]
    times: int = 1


_held: dict[Path, _Held] = {}
_held_lock = threading.Lock()


class WriterLock:
    """The exclusive right to write to a file, held until `release`.

    The same thread may take the lock several times. If the file system does not support locks, a warning is printed.

    Parameters
    ----------
    path
        The file to write.

    Raises
    ------
    InputError
        If another program or another thread has the lock, or the lock file cannot be created.
    """

    def __init__(self, path: Path) -> None:
        self._file = lock_file(path)
        owner = (os.getpid(), threading.get_ident())
        with _held_lock:
            held = _held.get(self._file)
            if held is not None and held.owner == owner:
                held.times += 1
                return
            descriptor = None if held is not None and held.owner[0] == owner[0] else _take(self._file, path)
            if descriptor is None:
                raise InputError(
                    f"{path}: is being written to by {_holder(self._file)}; wait until it has ended, or give another "
                    "name"
                )
            _held[self._file] = _Held(descriptor, owner)

    def release(self) -> None:
        """Release the lock. A lock that was taken twice has to be released twice."""
        with _held_lock:
            held = _held.get(self._file)
            if held is None or held.owner[0] != os.getpid():
                return
            held.times -= 1
            if held.times:
                return
            del _held[self._file]
            if held.descriptor < 0:
                return
            if sys.platform != "win32":
                self._file.unlink(missing_ok=True)  # before unlocking, while no other process can hold the lock
            unlock_descriptor(held.descriptor)  # closing is not enough if a forked process has the descriptor
            os.close(held.descriptor)
            if sys.platform == "win32":
                remove(self._file)  # the file stays if another program takes the lock now


def lock_file(path: Path) -> Path:
    """Return the path of the lock file that belongs to a file."""
    file = followed(path)
    return file.with_name(f".{file.name}.lock")


def is_being_written(path: Path) -> bool:
    """Return whether a process, also this process, holds the lock of a file."""
    file = lock_file(path)
    with _held_lock:
        if file in _held:
            return True
    try:
        descriptor = os.open(file, os.O_RDONLY | _NO_LINK)
    except OSError:
        return False
    try:
        return not lock_descriptor(descriptor, blocking=False)
    except OSError:
        return False
    finally:
        os.close(descriptor)  # closing also unlocks the file


@contextmanager
def only_writer(path: Path) -> Iterator[None]:
    """Hold the `WriterLock` of a file within the context. Raises InputError if another writer has the lock."""
    lock = WriterLock(path)
    try:
        yield
    finally:
        lock.release()


_NO_LOCK = -1
_LOCKED_BYTE = " "
"""First character of a lock file. Windows locks this character and lets no other program read it."""


def _take(file: Path, path: Path) -> int | None:
    """Take the lock of ``path`` on its lock file ``file``, and return the descriptor of the lock file.

    Returns None if another process holds the lock, and -1 if the file system does not support locks.
    """
    while True:
        try:
            descriptor = patiently(lambda: os.open(file, os.O_RDWR | os.O_CREAT | _NO_LINK, 0o666))
        except OSError as error:
            if file.is_symlink():
                raise InputError(f"{file}: is a link, but should be a lock file; remove the link") from error
            if not file.parent.is_dir():
                raise InputError(f"{path}: there is no folder {file.parent}") from error
            raise InputError(
                f"{path}: no file can be created in the folder {file.parent} ({error.strerror})"
            ) from error
        try:
            locked = lock_descriptor(descriptor, blocking=False)
        except OSError as error:
            os.close(descriptor)
            file.unlink(missing_ok=True)
            tell(f"warning: {path}: cannot be locked ({error.strerror}); no other program should write to this file")
            return _NO_LOCK
        if not locked:
            os.close(descriptor)
            return None
        with suppress(FileNotFoundError):  # the previous holder may have removed the lock file after it was opened here
            if os.path.samestat(os.fstat(descriptor), os.lstat(file)):
                break
        os.close(descriptor)
    command = " ".join([Path(sys.argv[0]).name, *sys.argv[1:2]])
    with suppress(OSError):  # on a full disk, the name of the holder is not stored
        if os.fstat(descriptor).st_nlink == 1:  # a file with a second name (hard link) may contain other data
            os.ftruncate(descriptor, 0)
            os.lseek(descriptor, 0, os.SEEK_SET)
            os.write(descriptor, f"{_LOCKED_BYTE}process {os.getpid()} on {platform.node()} ({command})".encode())
    return descriptor


def _holder(file: Path) -> str:
    """Return the text of the lock file about its holder: process, computer and command; or "another program"."""
    with suppress(OSError), open(os.open(file, os.O_RDONLY | _NO_LINK), "rb", buffering=0) as stored:
        stored.seek(len(_LOCKED_BYTE))
        if text := (stored.read(200) or b"").decode("utf-8", "replace"):
            return " ".join(text.split())
    return "another program"
