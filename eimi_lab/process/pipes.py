"""Read and write pipes between processes without waiting, and pass a pipe to a child process.

Windows: PeekNamedPipe and PIPE_NOWAIT (Microsoft, Windows API, namedpipeapi.h), and inherited handles
(processthreadsapi.h).
"""

from __future__ import annotations

import ctypes
import os
import select
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

LOOK_EVERY_S = 0.01
"""Interval (s) at which a process that waits for a pipe checks for data on Windows."""

if sys.platform == "win32":
    import msvcrt

    _PIPE_NOWAIT = ctypes.c_ulong(0x00000001)

    def _handle(descriptor: int) -> ctypes.c_void_p:
        return ctypes.c_void_p(msvcrt.get_osfhandle(descriptor))

    def _has_come(descriptor: int) -> bool:
        waiting = ctypes.c_ulong()
        peeked = ctypes.windll.kernel32.PeekNamedPipe(_handle(descriptor), None, 0, None, ctypes.byref(waiting), None)
        return not peeked or waiting.value > 0  # PeekNamedPipe fails after the other end was closed


def readable(descriptor: int, within_s: float) -> bool:
    """Return whether a pipe can be read without waiting, because data have arrived or the other end is closed.

    Parameters
    ----------
    descriptor
        The reading end of a pipe.
    within_s
        Longest time to wait for data, s.
    """
    if sys.platform == "win32":
        until = time.monotonic() + within_s
        while not _has_come(descriptor):
            if time.monotonic() >= until:
                return False
            time.sleep(LOOK_EVERY_S)
        return True
    return bool(select.select([descriptor], [], [], within_s)[0])


def never_wait_to_write(descriptor: int) -> None:
    """Let a write to a full pipe fail with an OSError, so that the writer never waits for the reader.

    Raises
    ------
    OSError
        If ``descriptor`` is not the descriptor of a pipe.
    """
    if sys.platform == "win32":
        state = ctypes.byref(_PIPE_NOWAIT)
        if not ctypes.windll.kernel32.SetNamedPipeHandleState(_handle(descriptor), state, None, None):
            raise ctypes.WinError()
    else:
        os.set_blocking(descriptor, False)


@contextmanager
def handed_down(*descriptors: int) -> Iterator[tuple[list[str], dict[str, Any]]]:
    """Pass file descriptors, such as the end of a pipe, to a child process that is started within the context.

    Yields
    ------
    names : list of str
        A name for each descriptor, for `received` in the child process.
    options : dict
        Options of `subprocess.Popen` for the start of the child.
    """
    if sys.platform == "win32":
        handles = [msvcrt.get_osfhandle(descriptor) for descriptor in descriptors]
        for handle in handles:
            os.set_handle_inheritable(handle, True)
        try:
            inherited = subprocess.STARTUPINFO(lpAttributeList={"handle_list": handles})
            yield [str(handle) for handle in handles], {"startupinfo": inherited}
        finally:
            for handle in handles:
                os.set_handle_inheritable(handle, False)
    else:
        yield [str(descriptor) for descriptor in descriptors], {"pass_fds": descriptors}


def received(name: str) -> int:
    """Return the file descriptor that the parent process passed to this process with `handed_down` under a name."""
    if sys.platform == "win32":
        return msvcrt.open_osfhandle(int(name), 0)
    return int(name)
