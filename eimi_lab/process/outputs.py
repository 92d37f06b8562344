"""Files that the suite writes: not over an existing one unless told to, nor one it reads, never half of one.

A symbolic link is followed: the file that it names is written, and it stays. Each file has one writer at a time.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from eimi_lab.process.errors import InputError
from eimi_lab.process.writer_lock import followed, only_writer


def refuse_existing(path: Path, force: bool) -> None:
    """Raise InputError when `path` cannot become a new file: it exists (and not `force`), or its folder does not."""
    folder = followed(path).parent
    if path.is_dir():
        raise InputError(f"{path}: is a folder; give the name of a file")
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: is a device or a pipe, which a file would replace; give the name of a file")
    if path.exists() and not force:
        raise InputError(f"{path}: exists already; give another name, or --force to replace it")
    if not folder.is_dir():
        raise InputError(f"{path}: there is no folder {folder if path.is_symlink() else path.parent}")
    if not os.access(folder, os.W_OK):
        raise InputError(f"{path}: the folder {folder} cannot be written to")


def check_distinct(read: Sequence[Path], written: Sequence[Path]) -> None:
    """Raise InputError where a file is given twice to read, or is to be written and read or written besides."""
    known = set()
    for path in read:
        if followed(path) in known:
            raise InputError(f"{path}: is given twice; give it once")
        known.add(followed(path))
    for path in written:
        if followed(path) in known:
            raise InputError(f"{path}: cannot be written, it is in use as another file here; give another name")
        known.add(followed(path))


@contextmanager
def whole_file(path: Path, force: bool) -> Iterator[Path]:
    """A temporary name beside `path` to write to; it takes the place of `path` only when the block ends well.

    Raises InputError as `refuse_existing` does, and where another program writes to `path`. On any error the temporary
    file is removed and `path` is as before.
    """
    refuse_existing(path, force)
    with only_writer(path):
        refuse_existing(path, force)  # again: the one who wrote it may just have finished
        file = followed(path)
        try:
            descriptor, name = tempfile.mkstemp(prefix=f".{file.name}.", dir=file.parent)
        except OSError as error:  # such as a file system mounted read-only
            raise InputError(f"{path}: the folder {file.parent} takes no new file ({error.strerror})") from error
        os.close(descriptor)
        temporary = Path(name)
        try:
            yield temporary
            with temporary.open("rb") as written:
                os.fsync(written.fileno())
            umask = os.umask(0)
            os.umask(umask)
            temporary.chmod(0o666 & ~umask)
            os.replace(temporary, file)
        except OSError as error:  # a full disk names no file, or one that nobody has heard of
            if error.errno is not None and (error.filename is None or name in (error.filename, error.filename2)):
                raise OSError(error.errno, error.strerror, str(path)) from error
            raise
        finally:
            temporary.unlink(missing_ok=True)


def write_file(path: Path, content: str | bytes, force: bool) -> None:
    """Write a file that is there whole or not at all; text as UTF-8. Raises InputError as `whole_file` does."""
    with whole_file(path, force) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)


def new_folder(folder: Path, force: bool) -> None:
    """Make a folder to fill. Raises InputError when it holds something already (and not `force`)."""
    if folder.is_dir() and any(not entry.name.startswith(".") for entry in folder.iterdir()) and not force:
        raise InputError(f"{folder}: is not empty; give another folder, or --force to replace files in it")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made a folder ({error.strerror})") from error


@contextmanager
def whole_folder(folder: Path, force: bool) -> Iterator[Path]:
    """A temporary folder to fill by `write_whole`; its files come into `folder` only when the block ends well.

    Raises InputError as `new_folder` does. On any error the temporary folder is removed, and `folder` is as before.
    """
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    new_folder(folder, force)
    try:
        try:  # inside, for beside it may be another file system
            unfinished = tempfile.TemporaryDirectory(prefix=".unfinished.", dir=folder)
        except OSError as error:
            raise InputError(f"{folder}: takes no new file ({error.strerror})") from error
        with unfinished as name:
            yield Path(name)
            for file in sorted(Path(name).iterdir()):
                _put(file, folder / file.name)
    except OSError as error:  # of a file by a name that nobody has heard of
        if error.errno is not None and error.filename and Path(error.filename).parent == Path(name):
            raise OSError(error.errno, error.strerror, str(folder / Path(error.filename).name)) from error
        raise
    finally:
        for path in missing:
            if path.is_dir() and not any(path.iterdir()):
                path.rmdir()


def _put(file: Path, path: Path) -> None:
    """Move a file over another one, through a link perhaps, and to another file system then."""
    if not path.is_symlink():
        os.replace(file, path)
        return
    with whole_file(path, force=True) as temporary:
        shutil.copyfile(file, temporary)
    file.unlink()


def write_whole(file: Path, content: bytes) -> None:
    """Write a file of a `whole_folder`. Raises OSError that names it, which that of a full disk does not by itself."""
    try:
        with file.open("wb") as output:
            output.write(content)
            output.flush()
            os.fsync(output.fileno())  # some file systems tell only here that there is no room
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(file)) from error
