"""Handle long paths on Windows, and symbolic links."""

from __future__ import annotations

import ntpath
import os
import sys
from pathlib import Path

from eimi_lab.process.errors import InputError

LONGEST_PLAIN = 160
"""Longest absolute path (characters) that is passed to Windows without the prefix for long paths.

Without the Windows setting LongPathsEnabled, a path has at most 259 characters, and the path of a folder at most 247
(Microsoft, "Maximum Path Length Limitation"). This number is smaller, because the program also writes files beside and
below a given path, whose paths are longer.
"""

_PREFIX, _UNC_PREFIX, _DEVICE = "\\\\?\\", "\\\\?\\UNC\\", "\\\\.\\"
_UNRESOLVED = (206, 234)
"""ERROR_FILENAME_EXCED_RANGE, and ERROR_MORE_DATA, which Wine reports for a path above 260 characters (winerror.h)."""


def reachable(path: Path) -> Path:
    r"""Return a path in a form that Windows can open, also if the path is long.

    A long path gets the form ``\\?\C:\folder``. On other systems the path is unchanged.
    """
    return Path(with_prefix(os.path.abspath(path), str(path))) if sys.platform == "win32" else path


def named_in(file: Path, name: str) -> Path:
    """Return the path of the file ``name``, which is given relative to the folder of ``file``."""
    return reachable(file.parent / name)


def with_prefix(absolute: str, short: str) -> str:
    r"""Return an absolute path of Windows, with the prefix for long paths if the path is long.

    Parameters
    ----------
    absolute
        The absolute path of Windows.
    short
        The result for a path that is not long.

    Returns
    -------
    str
        ``\\?\C:\folder`` or ``\\?\UNC\server\share\folder``, without ``..``, for a long path; otherwise ``short``.
    """
    if absolute.startswith(_UNC_PREFIX):  # `..` cannot lead above the shared folder
        return _UNC_PREFIX + ntpath.normpath("\\\\" + absolute.removeprefix(_UNC_PREFIX))[2:]
    if absolute.startswith(_PREFIX):  # behind the prefix, Windows treats `..` as the name of a folder
        return _PREFIX + ntpath.normpath(absolute.removeprefix(_PREFIX))
    drive = ntpath.splitdrive(absolute)[0]
    if len(absolute) <= LONGEST_PLAIN or absolute.startswith(_DEVICE):
        return short
    return _UNC_PREFIX + absolute[2:] if drive.startswith("\\\\") else _PREFIX + absolute


def followed(path: Path) -> Path:
    """Return a path with all symbolic links resolved. The file need not exist.

    Raises InputError if a link cannot be followed.
    """
    try:
        return path.resolve()
    except (OSError, RuntimeError) as error:  # before Python 3.13, a loop of links raises RuntimeError
        if getattr(error, "winerror", None) in _UNRESOLVED:
            return Path(os.path.abspath(path))
        raise InputError(f"{path}: is a symbolic link that cannot be followed ({error})") from error
