"""The terminal, or console, of the program: lines that a person types, and the closing of the terminal."""

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
        """Return the line that was typed, or None if no line is finished.

        The keys are read one by one, because on Windows reading a whole line would block the program.
        """
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
    """Return the line that was typed on the terminal, without spaces at its ends, or None if no line was typed.

    The function never waits. Nothing is read if the program is in the background of a terminal, because reading would
    stop the program there.
    """
    if sys.platform == "win32":
        return _typed_in_console()
    try:
        terminal = sys.stdin.fileno()
        if os.tcgetpgrp(terminal) != os.getpgrp() or not select.select([terminal], [], [], 0)[0]:
            return None
        return os.read(terminal, 1024).decode("utf-8", "replace").strip()
    except (OSError, ValueError, AttributeError):  # there is no terminal, or the terminal is closed
        return None


def handled(event: int, act: Callable[[], None]) -> int:
    """Call ``act`` if Windows closes the console, logs the user off or shuts down; leave Ctrl-C to Python.

    Windows calls this function for each event of the console. After a closing, a log-off or a shutdown, it ends the
    process as soon as the function returns.

    Parameters
    ----------
    event
        Number of the event: 0 is Ctrl-C and 1 is Ctrl-Break; 2, 5 and 6 are the closing of the console, a log-off and a
        shutdown.
    act
        The function to call.

    Returns
    -------
    int
        0 for Ctrl-C and Ctrl-Break, which Python then turns into signals. Otherwise 1, after ``act`` and a wait, during
        which the main thread can end the program in order.
    """
    if event not in _CLOSING:
        return 0
    act()
    time.sleep(HELD_S)
    return 1


def when_closed(act: Callable[[], None]) -> None:
    """Call ``act`` when Windows closes the console, logs the user off or shuts the computer down.

    ``act`` is called in a separate thread. Windows ends the process some seconds later, or when the main thread has
    ended. On other systems ``act`` is not called, because these systems send a signal (SIGHUP, SIGTERM).
    """
    if sys.platform == "win32":

        @ctypes.WINFUNCTYPE(ctypes.c_int, ctypes.c_ulong)
        def handle(event: int) -> int:
            return handled(event, act)

        _handlers.append(handle)
        ctypes.windll.kernel32.SetConsoleCtrlHandler(handle, 1)
