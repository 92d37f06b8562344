"""Write result files completely or not at all."""

from __future__ import annotations

import os
import secrets
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from eimi_lab.process.errors import InputError
from eimi_lab.process.paths import followed
from eimi_lab.process.replacing import patiently, remove, replace
from eimi_lab.process.writer_lock import only_writer


def refuse_existing(path: Path, force: bool) -> None:
    """Raise InputError if ``path`` cannot become a new file.

    The reason can be that the file exists (unless ``force`` is true), is not an ordinary file, or has no writable
    folder.
    """
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
    """Raise InputError if one command uses the same file twice, also under two names.

    Parameters
    ----------
    read
        The files that the command reads.
    written
        The files that the command writes.
    """
    used = set()
    for path in read:
        if followed(path) in used:
            raise InputError(f"{path}: is given twice; give it once")
        used.add(followed(path))
    for path in written:
        if followed(path) in used:
            raise InputError(
                f"{path}: cannot be written, because the same command already reads or writes this file; "
                "give another name"
            )
        used.add(followed(path))


@contextmanager
def whole_file(path: Path, force: bool) -> Iterator[Path]:
    """Yield the path of a new temporary file that replaces ``path`` when the context ends without an error.

    After an error, the temporary file is removed, and ``path`` is unchanged.

    Parameters
    ----------
    path
        The file to write.
    force
        Whether an existing file is replaced.

    Raises
    ------
    InputError
        If the file exists and ``force`` is false, if it cannot be created, or if another program writes to it.
    OSError
        If writing fails. The error names ``path``.
    """
    refuse_existing(path, force)
    with only_writer(path):
        refuse_existing(path, force)  # checked again, because another writer may have created the file
        file = followed(path)
        temporary = file.with_name(f".{file.name}.{secrets.token_hex(4)}")
        names = (None, str(temporary), temporary)
        try:
            yield temporary
            # Windows synchronises only a file that is open for writing.
            with patiently(lambda: temporary.open("r+b")) as written:
                os.fsync(written.fileno())
            replace(temporary, file)
        except OSError as error:  # on a full disk, the error names no file or the temporary one
            if error.errno is not None and (error.filename in names or error.filename2 == str(temporary)):
                raise OSError(error.errno, error.strerror, str(path)) from error
            raise
        finally:
            remove(temporary)


def write_file(path: Path, content: str | bytes, force: bool) -> None:
    """Write a file completely or not at all. Text is encoded as UTF-8.

    Raises InputError if the file exists and ``force`` is false, or if it cannot be created; OSError if writing fails.
    """
    with whole_file(path, force) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)


def new_folder(folder: Path, force: bool) -> None:
    """Create a folder for results.

    Raises InputError if the folder cannot be created, or is not empty and ``force`` is false.
    """
    if folder.is_dir() and any(not entry.name.startswith(".") for entry in folder.iterdir()) and not force:
        raise InputError(f"{folder}: is not empty; give another folder, or --force to replace files in it")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: the folder cannot be created ({error.strerror})") from error


@contextmanager
def whole_folder(folder: Path, force: bool) -> Iterator[Path]:
    """Yield a temporary folder whose files are moved to ``folder`` when the context ends without an error.

    Write the files with `write_whole`. After an error, the temporary folder is removed, and ``folder`` is unchanged.

    Parameters
    ----------
    folder
        The folder to fill.
    force
        Whether the folder may contain files already.

    Raises
    ------
    InputError
        If the folder contains files and ``force`` is false, or if it cannot be created.
    OSError
        If writing fails. The error names the file in ``folder``.
    """
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    new_folder(folder, force)
    try:
        try:  # created inside the folder, because its parent may be on another file system
            unfinished = tempfile.TemporaryDirectory(prefix=".unfinished.", dir=folder, ignore_cleanup_errors=True)
        except OSError as error:
            raise InputError(f"{folder}: no file can be created in this folder ({error.strerror})") from error
        with unfinished as name:
            yield Path(name)
            for file in sorted(Path(name).iterdir()):
                _put(file, folder / file.name)
    except OSError as error:  # the error may name the temporary file
        if error.errno is not None and error.filename and Path(error.filename).parent == Path(name):
            raise OSError(error.errno, error.strerror, str(folder / Path(error.filename).name)) from error
        raise
    finally:
        for path in missing:
            if path.is_dir() and not any(path.iterdir()):
                path.rmdir()


def _put(file: Path, path: Path) -> None:
    """Move a file to ``path``. If ``path`` is a symbolic link, copy the file over the target of the link."""
    if not path.is_symlink():
        replace(file, path)
        return
    with whole_file(path, force=True) as temporary:
        shutil.copyfile(file, temporary)


def write_whole(file: Path, content: bytes) -> None:
    """Write a file and wait until its content is on the disk. Raises OSError if writing fails."""
    try:
        with file.open("wb") as output:
            output.write(content)
            output.flush()
            os.fsync(output.fileno())  # some file systems report only here that the disk is full
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(file)) from error
