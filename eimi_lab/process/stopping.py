"""Being asked to stop by a signal is no error, but every open file and every coil has to hear of it."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

TERMINATION = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))
AGAIN_AFTER_S = 0.05


class Stopped(BaseException):
    """A signal asked the program to stop. Nothing that handles errors may swallow it."""

    def __init__(self, number: int, left: str = "") -> None:
        """left: what the program leaves behind, in words."""
        super().__init__(f"stopped by {signal.Signals(number).name}" + (f": {left}" if left else ""))
        self.number, self.left = number, left

    def in_words(self) -> str:
        """What it says; where a second signal came on the way out, what the first one left behind."""
        before = self.__context__
        while before is not None:
            if isinstance(before, Stopped) and before.left:
                return str(before)
            before = before.__context__
        return str(self)


_asked: list[int] = []


def unwind_on_termination() -> None:
    """Let Ctrl-C, termination and hang-up raise Stopped. What is ignored stays ignored.

    In a destructor, or a callback of a library in C, Python has nowhere to raise to, tells of the error and drops it. A
    Stopped is not dropped: the same signal comes again a moment later.
    """
    for number in (signal.SIGINT, *TERMINATION):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _raise)
    tell_of_it = sys.unraisablehook

    def come_again(dropped: UnraisableHookArgs) -> None:
        if isinstance(dropped.exc_value, Stopped):
            threading.Timer(AGAIN_AFTER_S, _signal_main_thread, [dropped.exc_value.number]).start()
        else:
            tell_of_it(dropped)

    sys.unraisablehook = come_again


@contextmanager
def leaving() -> Iterator[None]:
    """For the last words: all that had to end has ended, and a further signal waits for them; later ones end it."""
    heeded = [n for n in (signal.SIGINT, *TERMINATION) if signal.getsignal(n) is _raise]
    for number in heeded:
        signal.signal(number, signal.SIG_IGN)
    try:
        yield
    finally:
        for number in heeded:
            signal.signal(number, signal.SIG_DFL)


def raise_if_asked() -> None:
    """Raise Stopped once more when it was raised before: in a destructor or a callback Python swallows it."""
    if _asked:
        raise Stopped(_asked[0])


def _signal_main_thread(number: int) -> None:
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident or 0, number)  # which wakes it where it waits
    else:
        signal.raise_signal(number)


def _raise(number: int, frame: FrameType | None) -> None:
    _asked.append(number)
    raise Stopped(number)
