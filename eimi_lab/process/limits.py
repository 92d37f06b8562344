"""Limit memory and processor time for reading files, because a small damaged file may require much of both.

The limits of a process are soft limits (setrlimit(2)). On Windows, only the elapsed time of a child process is limited.
"""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from eimi_lab.process.errors import InputError

ASSUMED_FREE_BYTES = 4 << 30
"""Assumed free memory (bytes) if the operating system does not report it."""
SHARE_OF_FREE = 4
"""Number by which the free memory is divided. The quotient is the largest size of data that are unpacked at once."""
_CRASHED = 0xC0000000
"""Smallest exit status with which Windows reports that a process crashed (Microsoft, [MS-ERREF], NTSTATUS)."""
WALL_WITHIN_S = 3600.0
"""Longest elapsed time (s) of a child process, because a child process may wait forever for a disk or a network."""


def free_memory_bytes() -> int:
    """Return the memory (bytes) that this process can still use, as the operating system reports it.

    Half of the installed memory is assumed on macOS, and 4 GiB if the system reports nothing.
    """
    free = _linux() if sys.platform == "linux" else _windows() if sys.platform == "win32" else _macos()
    if sys.platform == "win32":
        return free or ASSUMED_FREE_BYTES
    import resource

    if not free:
        with suppress(AttributeError, ValueError, OSError):
            free = os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    free = free if free > 0 else ASSUMED_FREE_BYTES
    soft = resource.getrlimit(resource.RLIMIT_AS)[0]
    return free if soft == resource.RLIM_INFINITY else min(free, soft)


def refuse_unpacked(claimed_bytes: int, what: str) -> None:
    """Raise InputError if unpacked data would take more than a quarter of the free memory.

    Parameters
    ----------
    claimed_bytes
        Size of the unpacked data according to the file.
    what
        The file and its part, for the error message, such as "run.h5: frame 3".
    """
    most = free_memory_bytes() // SHARE_OF_FREE
    if claimed_bytes > most:
        raise InputError(
            f"{what} would take {claimed_bytes / 1e9:.3g} GB of memory; at most a quarter of the free memory of this "
            f"computer is used, which is {most / 1e9:.2g} GB now"
        )


def limit_memory(most_bytes: int) -> None:
    """Limit the address space of this process to ``most_bytes``, if the operating system supports this.

    A lower limit is kept.
    """
    _lower("RLIMIT_AS", most_bytes)


def run_limited(path: Path, command: Sequence[str], within_s: float) -> subprocess.CompletedProcess[bytes]:
    """Run a command that reads a file in a child process, with a limit of its processor time.

    Parameters
    ----------
    path
        The file, for messages.
    command
        The program and the arguments of the child process; the limit is added as the last argument. The child reads its
        arguments with `child_arguments` and calls `obey_processor_limit`.
    within_s
        Limit of the processor time (on Windows, of the elapsed time), s.

    Returns
    -------
    subprocess.CompletedProcess
        The exit status and the output of the child process.

    Raises
    ------
    InputError
        If the command took too long, was killed, or crashed.
    """
    wall_s = within_s if sys.platform == "win32" else within_s + WALL_WITHIN_S
    try:
        done = subprocess.run([*command, str(round(within_s))], capture_output=True, timeout=wall_s, check=False)
    except subprocess.TimeoutExpired as error:
        raise InputError(f"{path}: reading the file took longer than {wall_s:.0f} s") from error
    if 0 <= done.returncode < _CRASHED:
        return done
    if sys.platform == "win32":
        raise InputError(
            f"{path}: is damaged: the process that read this file crashed (exit status {done.returncode:#x})"
        )
    name = signal.Signals(-done.returncode).name
    if name == "SIGXCPU":
        raise InputError(f"{path}: reading the file took longer than {within_s:.0f} s of processor time")
    if name in ("SIGKILL", "SIGTERM", "SIGINT", "SIGHUP"):
        raise InputError(f"{path}: the process that read the file was ended by {name}; the memory may not suffice")
    raise InputError(f"{path}: is damaged: the process that read this file crashed (signal {name})")


def child_arguments(count: int) -> list[str]:
    """Return the command-line arguments of this process, which `run_limited` started.

    The last argument is the limit of the processor time (s). If there are not ``count`` arguments, the process ends
    with exit status 2.
    """
    arguments = sys.argv[1:]
    if len(arguments) != count:
        print("eimi-lab was replaced by another release while it ran; start the command again", file=sys.stderr)
        sys.exit(2)
    return arguments


def obey_processor_limit(within_s: str) -> None:
    """Let the operating system end this process after ``within_s`` seconds of processor time; not on Windows."""
    _lower("RLIMIT_CPU", int(within_s))


def _lower(name: str, most: int) -> None:
    """Lower the soft limit ``name`` of this process, such as "RLIMIT_CPU" in setrlimit(2), to at most ``most``."""
    if sys.platform != "win32":
        import resource

        which: int = getattr(resource, name)
        soft, hard = resource.getrlimit(which)
        limits = [limit for limit in (most, soft, hard) if limit != resource.RLIM_INFINITY]
        with suppress(ValueError):
            resource.setrlimit(which, (min(limits), hard))


def _linux() -> int:
    with suppress(OSError, ValueError, IndexError):
        for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) << 10
    return 0


def _windows() -> int:
    class MemoryStatus(ctypes.Structure):  # MEMORYSTATUSEX of sysinfoapi.h (Microsoft)
        _fields_ = [
            ("length", ctypes.c_uint32),
            ("load", ctypes.c_uint32),
            *((name, ctypes.c_uint64) for name in ("total", "free", "f3", "f4", "f5", "f6", "f7")),
        ]

    status = MemoryStatus()
    status.length = ctypes.sizeof(status)
    library = getattr(ctypes, "windll", None)
    return int(status.free) if library and library.kernel32.GlobalMemoryStatusEx(ctypes.byref(status)) else 0


def _macos() -> int:
    with suppress(OSError, AttributeError):
        total, length = ctypes.c_uint64(0), ctypes.c_size_t(8)
        if not ctypes.CDLL(None).sysctlbyname(b"hw.memsize", ctypes.byref(total), ctypes.byref(length), None, 0):
            return total.value // 2
    return 0
