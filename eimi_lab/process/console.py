"""Read lines that a person types on the terminal, and react to the closing of the terminal."""

from __future__ import annotations

import ctypes
import os
import select
import sys
import time
from collections.abc import Callable

_CLOSING = (2, 5, 6)
"""CTRL_CLOSE_EVENT, CTRL_LOGOFF_EVENT and CTRL_SHUTDOWN_EVENT (Microsoft, consoleapi.h, HandlerRoutine)."""
HELD_S = 60.0
"""Time (s) for which a handler waits after its work. Windows ends the process earlier, 5 s after the console closes."""

if sys.platform == "win32":
    import msvcrt

    _handlers: list[object] = []  # keeps the handlers alive, because ctypes does not
    _unfinished: list[str] = []

    def _typed_in_console() -> str | None:
        """Return the line that was typed in a Windows console, or None if no line is finished."""
        while sys.stdin is not None and sys.stdin.isatty() and msvcrt.kbhit():
            key = msvcrt.getwche()
            if key in "\r\n":
                msvcrt.putwch("\n")
                line = "".join(_unfinished).strip()
                _unfinished.clear()
                return line
            if key == "\b":
                del _unfinished[-1:]
            else:
                _unfinished.append(key)
        return None


def typed_line() -> str | None:
    """Return the line that was typed on the terminal, or None if no line was typed. The function never waits."""
    if sys.platform == "win32":
        return _typed_in_console()
    try:
        terminal = sys.stdin.fileno()
        # reading in the background of a terminal would stop the program
        if os.tcgetpgrp(terminal) != os.getpgrp() or not select.select([terminal], [], [], 0)[0]:
            return None
        typed = os.read(terminal, 1024)  # empty after Ctrl-D
        return typed.decode("utf-8", "replace").strip() if typed else None
    except (OSError, ValueError, AttributeError):  # there is no terminal, or the terminal is closed
        return None


def handled(event: int, act: Callable[[], None]) -> int:
    """Call ``act`` if Windows closes the console, logs the user off or shuts down; leave Ctrl-C to Python.

    Windows calls this function, and ends the process after a closing, a log-off or a shutdown when the function
    returns.

    Parameters
    ----------
    event
        Number of the event: 0 Ctrl-C, 1 Ctrl-Break, 2 closing, 5 log-off, 6 shutdown.
    act
        The function to call.

    Returns
    -------
    int
        0 for Ctrl-C and Ctrl-Break; otherwise 1, after ``act`` and a wait for the end of the main thread.
    """
    if event not in _CLOSING:
        return 0
    act()
    time.sleep(HELD_S)
    return 1


def when_closed(act: Callable[[], None]) -> None:
    """Call ``act``, in another thread, when Windows closes the console, logs the user off or shuts down.

    Windows ends the process some seconds later. On other systems ``act`` is not called.
    """
    if sys.platform == "win32":

        @ctypes.WINFUNCTYPE(ctypes.c_int, ctypes.c_ulong)
        def handle(event: int) -> int:
            return handled(event, act)

        _handlers.append(handle)
        ctypes.windll.kernel32.SetConsoleCtrlHandler(handle, 1)
