"""Standard error that nobody has to read: a full pipe or a terminal held with Ctrl-S must not keep a coil on.

What does not go out at once waits in memory and goes with the next write; what is too much for that is dropped, and
counted.
"""

from __future__ import annotations

import io
import os
import select
import stat
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

MOST_BYTES = 1 << 20
AT_ONCE_BYTES = 512  # so much a pipe takes whole where it takes anything (POSIX, write: PIPE_BUF)
FINISH_WITHIN_S = 2.0
TOLD = b" lines were dropped: nobody read them"


class NeverBlocking(io.TextIOBase):
    """Text to a file descriptor whose other end may have stopped reading."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = _apart(descriptor)
        self._waiting = bytearray()
        self._dropped = 0
        self._alone = threading.Lock()
        self._original = descriptor

    @property
    def encoding(self) -> str:  # type: ignore[override]  # a read-only attribute of the base
        """UTF-8."""
        return "utf-8"

    def fileno(self) -> int:
        """The descriptor that was given."""
        return self._original

    def isatty(self) -> bool:
        """Whether a person may be reading."""
        return os.isatty(self._original)

    def writable(self) -> bool:
        """Always."""
        return True

    def write(self, text: str) -> int:
        """Take a text; returns at once."""
        with self._alone:
            self._waiting += text.encode("utf-8", "backslashreplace")
            self._send()
            if len(self._waiting) > MOST_BYTES:
                self._drop_the_older_half()
        return len(text)

    def _drop_the_older_half(self) -> None:
        kept = self._waiting[-MOST_BYTES // 2 :].partition(b"\n")[2]
        told_before = self._waiting.count(TOLD)
        self._dropped += self._waiting.count(b"\n") - kept.count(b"\n") - 2 * told_before
        self._waiting = bytearray(b"\neimi: %d%b\n" % (self._dropped, TOLD)) + kept

    def flush(self) -> None:
        """Send what goes out without waiting."""
        with self._alone:
            self._send()

    def finish(self) -> None:
        """Send the rest, for a moment."""
        until = time.monotonic() + FINISH_WITHIN_S
        while self._waiting and time.monotonic() < until:
            self.flush()
            if self._waiting:
                time.sleep(0.01)
        os.close(self._descriptor)

    def _send(self) -> None:
        try:
            while self._waiting and select.select([], [self._descriptor], [], 0)[1]:
                del self._waiting[: os.write(self._descriptor, self._waiting[:AT_ONCE_BYTES])]
        except BlockingIOError:
            return
        except OSError:  # the reader is gone for good
            self._waiting.clear()


def open_what_is_closed() -> None:
    """A program begun without standard streams (`2>&-`) would give their numbers to the files that it writes."""
    for descriptor, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest number that is free: this one
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(descriptor, "w" if descriptor else "r", closefd=False))


@contextmanager
def never_blocking() -> Iterator[None]:
    """Standard error takes every text at once while the context lasts."""
    before = sys.stderr
    try:
        stream = NeverBlocking(before.fileno())
    except (OSError, ValueError, AttributeError):  # in memory, closed, or none at all
        yield
        return
    before.flush()
    sys.stderr = stream
    try:
        yield
    finally:
        sys.stderr = before
        stream.finish()


def _apart(descriptor: int) -> int:
    """The same file, opened anew where that can be done, since not waiting would be felt by all who share the old one.

    Opened anew, a plain file would be written from its beginning.
    """
    mode = os.fstat(descriptor).st_mode
    if stat.S_ISFIFO(mode) or stat.S_ISCHR(mode):
        with suppress(OSError):
            return os.open(f"/dev/fd/{descriptor}", os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY)
    return os.dup(descriptor)
