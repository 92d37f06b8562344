"""End the program in an orderly way after a signal: raise `Stopped`, close the files and switch the coils off."""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING

from eimi_lab.process.console import when_closed

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

TERMINATION = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name))
"""The signals that end the program, except Ctrl-C. Windows has SIGBREAK for Ctrl-Break; the program also sends SIGBREAK
to itself when the console is closed, the user logs off or the computer is shut down.
"""

SIGNALS_BETWEEN_PROCESSES = sys.platform != "win32"
"""Whether a process can send a signal to another process; on Windows it can only end the other process."""

AGAIN_AFTER_S = 0.05
IN_HASTE_AFTER_S = 1.0
"""Time (s) from the first signal to the second when a Windows console is closed. Windows ends the process after 5 s."""


class Stopped(BaseException):
    """The exception that is raised if a signal, such as Ctrl-C, asks the program to stop.

    Handlers of `Exception` do not catch it.

    Parameters
    ----------
    number
        Number of the signal.
    left
        What became of the files and instruments, for the message.
    """

    def __init__(self, number: int, left: str = "") -> None:
        super().__init__(f"stopped by {signal.Signals(number).name}" + (f": {left}" if left else ""))
        self.number, self.left = number, left

    def in_words(self) -> str:
        """Return the message; if two signals stopped the program, the message of the first one."""
        earlier = self.__context__
        while earlier is not None:
            if isinstance(earlier, Stopped) and earlier.left:
                return str(earlier)
            earlier = earlier.__context__
        return str(self)


_received: list[int] = []


def unwind_on_termination() -> None:
    """Let Ctrl-C, termination and hang-up raise `Stopped`. A signal that is ignored stays ignored."""
    for number in (signal.SIGINT, *TERMINATION):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _raise)
    when_closed(_leave_the_console)
    report = sys.unraisablehook

    # Python drops an error that is raised in a destructor or in a callback of a C library.
    def send_again(dropped: UnraisableHookArgs) -> None:
        if isinstance(dropped.exc_value, Stopped):
            threading.Timer(AGAIN_AFTER_S, signal_main_thread, [dropped.exc_value.number]).start()
        else:
            report(dropped)

    sys.unraisablehook = send_again


@contextmanager
def leaving() -> Iterator[None]:
    """Ignore Ctrl-C and the other signals that end the program, while it prints its last lines in the context."""
    handled = [n for n in (signal.SIGINT, *TERMINATION) if signal.getsignal(n) is _raise]
    for number in handled:
        signal.signal(number, signal.SIG_IGN)
    try:
        yield
    finally:
        for number in handled:
            signal.signal(number, signal.SIG_DFL)


def raise_if_asked() -> None:
    """Raise `Stopped` if a signal, such as Ctrl-C, has asked the program to stop."""
    if _received:
        raise Stopped(_received[0])


def signal_main_thread(number: int) -> None:
    """Send a signal to this process. Any thread may call this; the main thread handles the signal."""
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident or 0, number)  # this also interrupts a waiting system call
    else:
        signal.raise_signal(number)


def _leave_the_console() -> None:
    signal_main_thread(TERMINATION[-1])
    time.sleep(IN_HASTE_AFTER_S)
    signal_main_thread(TERMINATION[0])


def _raise(number: int, frame: FrameType | None) -> None:
    _received.append(number)
    raise Stopped(number)
