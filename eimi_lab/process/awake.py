"""Keep the computer awake, and read a clock that continues while it sleeps, if the system supports this."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

_CONTINUOUS, _SYSTEM_REQUIRED = 0x80000000, 0x00000001
"""Flags of SetThreadExecutionState (Microsoft, Windows API, winbase.h)."""


def awake_s() -> float:
    """Return the time (s) on a clock that continues while the computer sleeps, if the system has such a clock.

    Only differences of two returned times have a meaning. Sources: clock_gettime(2) on Linux, clock_gettime(3) on
    macOS, GetTickCount64 in the Windows API (sysinfoapi.h).
    """
    if sys.platform == "win32":
        import ctypes

        ticks = ctypes.windll.kernel32.GetTickCount64
        ticks.restype = ctypes.c_uint64
        return float(ticks()) / 1000
    if sys.platform == "linux":
        return time.clock_gettime(time.CLOCK_BOOTTIME)
    return time.clock_gettime(time.CLOCK_MONOTONIC)


@contextmanager
def kept_awake(reason: str) -> Iterator[None]:
    """Keep the computer awake within the context, if the operating system supports this.

    A person can put the computer to sleep nevertheless.

    Parameters
    ----------
    reason
        Reason for staying awake, which Linux shows to a person who asks.
    """
    if sys.platform == "win32":
        import ctypes

        ctypes.windll.kernel32.SetThreadExecutionState(_CONTINUOUS | _SYSTEM_REQUIRED)
        try:
            yield
        finally:
            ctypes.windll.kernel32.SetThreadExecutionState(_CONTINUOUS)
        return
    inhibitor = _inhibitor(reason)
    try:
        yield
    finally:
        if inhibitor:
            assert inhibitor.stdin is not None
            with suppress(OSError):
                inhibitor.stdin.close()
            inhibitor.terminate()
            inhibitor.wait()


def _inhibitor(reason: str) -> subprocess.Popen[bytes] | None:
    """Start a program that keeps the computer awake until its standard input closes; return None if this fails."""
    if sys.platform == "darwin":
        command = ["caffeinate", "-i", "-s", "-w", str(os.getpid())]
    else:
        command = ["systemd-inhibit", "--what=sleep:idle", "--who=eimi", f"--why={reason}", "cat"]
    if shutil.which(command[0]) is None:
        return None
    try:
        return subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C must not end this program before the run
        )
    except OSError:
        return None
