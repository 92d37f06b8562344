"""Replace, remove and open files that another program may have open.

On Windows, a file that a program (such as a virus scanner or a spreadsheet) has open can be neither replaced nor
removed.
"""

from __future__ import annotations

import errno
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

TRY_FOR_S = 5.0
TRY_AGAIN_AFTER_S = 0.05
_IN_USE = (5, 32, 33)
"""ERROR_ACCESS_DENIED, ERROR_SHARING_VIOLATION and ERROR_LOCK_VIOLATION (Microsoft, winerror.h)."""

AnyResult = TypeVar("AnyResult")


def replace(file: Path, path: Path) -> None:
    """Move ``file`` to ``path``, and replace a file that exists at ``path``.

    On Windows, the move is tried for some seconds.

    Raises
    ------
    OSError
        If the file cannot be moved, for example because another program has it open.
    """
    try:
        patiently(lambda: os.replace(file, path))
    except PermissionError as error:
        if not _in_use(error):
            raise
        raise PermissionError(
            f"{path}: cannot be replaced ({error.strerror}): another program has the file open, or the file is "
            "write-protected; close the file in that program, or remove the protection, and repeat the command"
        ) from error


def remove(file: Path) -> None:
    """Remove a file if it exists.

    A file that another program has open is left without an error after some seconds.
    """
    try:
        patiently(lambda: file.unlink(missing_ok=True))
    except PermissionError as error:
        if not _in_use(error):
            raise


def patiently(act: Callable[[], AnyResult]) -> AnyResult:
    """Call a function that opens, replaces or removes a file, and return its result.

    On Windows, the call is repeated for some seconds while another program has the file open.

    Raises
    ------
    OSError
        If ``act`` raises this error; on Windows, a PermissionError only after the last attempt.
    """
    until = time.monotonic() + TRY_FOR_S
    while True:
        try:
            return act()
        except PermissionError as error:
            if not _in_use(error) or time.monotonic() >= until:
                raise
        time.sleep(TRY_AGAIN_AFTER_S)


def _in_use(error: PermissionError) -> bool:
    if sys.platform != "win32":
        return False
    # The functions of C that open a file for Python and HDF5 report every one of these errors as EACCES.
    number = getattr(error, "winerror", None)
    return error.errno == errno.EACCES if number is None else number in _IN_USE
