"""One writer a file: a lock beside it, held as long as it is written to and released by the death of its holder.

The lock is flock(2) on a file of its own, `.run.h5.lock` beside `run.h5`: HDF5 locks the data itself, for moments of
its own choice, and a file that is replaced takes a lock on it along. Links are followed, so that two names of a file
share one lock. A run that was killed leaves the lock's file behind, which holds nothing and is used again.
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

from eimi_lab.process.errors import InputError, tell

try:
    import fcntl
except ImportError:  # Windows, where HDF5's own lock is all there is
    fcntl = None  # type: ignore[assignment]


def followed(path: Path) -> Path:
    """The file that a name stands for, symbolic links followed; it need not exist. Raises InputError."""
    try:
        return path.resolve()
    except (OSError, RuntimeError) as error:  # RuntimeError is Python's for a loop of links before 3.13
        raise InputError(f"{path}: is a symbolic link that leads nowhere ({error})") from error


@dataclass
class _Held:
    """A lock of this process: who holds it, and how often over."""

    descriptor: int
    owner: tuple[int, int]
    times: int = 1


_held: dict[Path, _Held] = {}
_at_once = threading.Lock()


class WriterLock:
    """The right to write to `path`, from its making until `release`. The same thread may take it again.

    Raises InputError at once where another program, or another thread, has it. Where the file system knows no locks,
    a warning is told, and there is none.
    """

    def __init__(self, path: Path) -> None:
        self._file = lock_file(path)
        owner = (os.getpid(), threading.get_ident())
        with _at_once:
            held = _held.get(self._file)
            if held is not None and held.owner == owner:
                held.times += 1
                return
            descriptor = None if held is not None and held.owner[0] == owner[0] else _take(self._file, path)
            if descriptor is None:
                raise InputError(
                    f"{path}: is being written to by {_holder(self._file)}; wait until that has ended, or give another "
                    "name"
                )
            _held[self._file] = _Held(descriptor, owner)

    def release(self) -> None:
        """Let others write; a lock that was taken twice is released twice."""
        with _at_once:
            held = _held.get(self._file)
            if held is None or held.owner[0] != os.getpid():
                return
            held.times -= 1
            if held.times:
                return
            del _held[self._file]
            if held.descriptor < 0:
                return
            self._file.unlink(missing_ok=True)  # first: nobody else can have locked it meanwhile
            fcntl.flock(held.descriptor, fcntl.LOCK_UN)  # a forked process has the descriptor as well
            os.close(held.descriptor)


def lock_file(path: Path) -> Path:
    """Where the lock of a file is."""
    file = followed(path)
    return file.with_name(f".{file.name}.lock")


def is_being_written(path: Path) -> bool:
    """Whether somebody has the lock of a file, this process included."""
    file = lock_file(path)
    with _at_once:
        if file in _held:
            return True
    try:
        descriptor = os.open(file, os.O_RDONLY)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    finally:
        os.close(descriptor)
    return False


@contextmanager
def only_writer(path: Path) -> Iterator[None]:
    """Nobody else writes to `path` while the context lasts. Raises InputError as `WriterLock` does."""
    lock = WriterLock(path)
    try:
        yield
    finally:
        lock.release()


_NO_LOCK = -1


def _take(file: Path, path: Path) -> int | None:
    """A descriptor that holds the lock; None where somebody else does, -1 where there are no locks."""
    if fcntl is None:
        return _NO_LOCK
    while True:
        try:
            descriptor = os.open(file, os.O_RDWR | os.O_CREAT, 0o666)
        except OSError as error:
            if not file.parent.is_dir():
                raise InputError(f"{path}: there is no folder {file.parent}") from error
            raise InputError(f"{path}: the folder {file.parent} takes no new file ({error.strerror})") from error
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(descriptor)
            return None
        except OSError as error:
            os.close(descriptor)
            file.unlink(missing_ok=True)
            tell(f"warning: {path}: cannot be locked here ({error.strerror}); see that nobody else writes to it")
            return _NO_LOCK
        with suppress(FileNotFoundError):  # its last holder may have removed it since it was opened
            if os.path.samestat(os.fstat(descriptor), os.stat(file)):
                break
        os.close(descriptor)
    command = " ".join([Path(sys.argv[0]).name, *sys.argv[1:2]])
    with suppress(OSError):  # a full disk; who holds it is then not known
        os.truncate(descriptor, 0)
        os.pwrite(descriptor, f"process {os.getpid()} on {platform.node()} ({command})".encode(), 0)
    return descriptor


def _holder(file: Path) -> str:
    """Who holds a lock, as he wrote it down."""
    with suppress(OSError):
        if text := file.read_bytes()[:200].decode("utf-8", "replace"):
            return " ".join(text.split())
    return "another program"
