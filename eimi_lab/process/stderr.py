"""Write to standard error without waiting for a reader, and collect the text that C libraries print there.

Text that cannot be written at once waits in memory. If too much text waits, the oldest lines are dropped and counted.
"""

from __future__ import annotations

import io
import os
import select
import stat
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

MOST_BYTES = 1 << 20
AT_ONCE_BYTES = 512  # a pipe that accepts any data accepts this much at once (POSIX, write: PIPE_BUF)
FINISH_WITHIN_S = 2.0
NOTICE = b" lines were dropped: nobody read them"


class NeverBlocking(io.TextIOBase):
    """A text stream to a file descriptor that never waits for the reader at the other end."""

    def __init__(self, descriptor: int) -> None:
        self._open(descriptor)
        self._waiting = bytearray()
        self._dropped = 0
        self._lock = threading.Lock()
        self._original = descriptor

    def _open(self, descriptor: int) -> None:
        self._descriptor = _reopened(descriptor)

    @property
    def encoding(self) -> str:  # type: ignore[override]  # a read-only attribute of the base
        """The encoding of the stream, UTF-8."""
        return "utf-8"

    def fileno(self) -> int:
        """Return the descriptor with which the stream was created."""
        return self._original

    def isatty(self) -> bool:
        """Return whether the stream is a terminal."""
        return os.isatty(self._original)

    def writable(self) -> bool:
        """Return True."""
        return True

    def write(self, text: str) -> int:
        """Accept a text, and return its length at once. Text that cannot be written now waits in memory."""
        with self._lock:
            self._waiting += text.encode("utf-8", "backslashreplace")
            self._send()
            if len(self._waiting) > MOST_BYTES:
                self._drop_the_older_half()
        return len(text)

    def _drop_the_older_half(self) -> None:
        kept = self._waiting[-MOST_BYTES // 2 :].partition(b"\n")[2]
        earlier_notices = self._waiting.count(NOTICE)  # each notice has two line ends
        self._dropped += self._waiting.count(b"\n") - kept.count(b"\n") - 2 * earlier_notices
        self._waiting = bytearray(b"\neimi: %d%b\n" % (self._dropped, NOTICE)) + kept

    def flush(self) -> None:
        """Write all text that can be written without waiting."""
        with self._lock:
            self._send()

    def finish(self) -> None:
        """Try for a limited time to write the waiting text, then close the stream."""
        until = time.monotonic() + FINISH_WITHIN_S
        while self._left() and time.monotonic() < until:
            self.flush()
            if self._left():
                time.sleep(0.01)
        self._close()

    def _left(self) -> bool:
        """Return whether some of the accepted text still waits to be written."""
        return bool(self._waiting)

    def _close(self) -> None:
        os.close(self._descriptor)

    def _send(self) -> None:
        try:
            while self._waiting and select.select([], [self._descriptor], [], 0)[1]:
                self._send_a_piece()
        except BlockingIOError:
            return
        except OSError:  # the reader has closed its end
            self._waiting.clear()

    def _send_a_piece(self) -> None:
        """Write the first bytes of the waiting text, and remove the written bytes from it, also after an error."""
        # The handler of a signal may raise an error between any two function calls. After an error between writing and
        # removing, the bytes would be written twice. `extend` therefore writes and stores the number in one call.
        written_bytes: list[int] = []
        try:
            written_bytes.extend(map(os.write, (self._descriptor,), (self._waiting[:AT_ONCE_BYTES],)))
        finally:
            if written_bytes:
                del self._waiting[: written_bytes[0]]


class WrittenByThread(NeverBlocking):
    """A text stream for Windows that a separate thread writes, so that the program never waits for the reader."""

    def _open(self, descriptor: int) -> None:
        self._raw = open(os.dup(descriptor), "wb", buffering=0)  # noqa: SIM115  # closed in `_close`
        self._to_send = threading.Semaphore(0)
        self._sending = False
        threading.Thread(target=self._write_all, name="standard error", daemon=True).start()

    def _left(self) -> bool:
        with self._lock:
            return bool(self._waiting) or self._sending

    def _close(self) -> None:
        if not self._left():  # otherwise the thread is in a write, which closing would have to wait for
            self._raw.close()

    def _send(self) -> None:
        self._to_send.release()

    def _write_all(self) -> None:
        while self._to_send.acquire():
            with self._lock:
                text = bytes(self._waiting)
                self._waiting.clear()
                self._sending = bool(text)
            with suppress(OSError, ValueError):  # the reader has closed its end, or the stream is closed
                while text:
                    text = text[self._raw.write(text) or len(text) :]
            self._sending = False


def write_every_character() -> None:
    """Make standard output and standard error accept every character.

    On Windows, a stream that is not a console receives UTF-8. Elsewhere, a character that is missing in the encoding of
    the terminal is written with a backslash.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            utf8 = sys.platform == "win32" and not stream.isatty()
            stream.reconfigure(encoding="utf-8" if utf8 else None, errors="backslashreplace")


def open_closed_streams() -> None:
    """Open the null device for each standard stream that is closed (as by ``2>&-``)."""
    for descriptor, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the system assigns the lowest free descriptor, which is this one
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(descriptor, "w" if descriptor else "r", closefd=False))


@contextmanager
def never_blocking() -> Iterator[None]:
    """Replace standard error (`sys.stderr`) within the context by a stream that never waits for its reader."""
    before = sys.stderr
    try:
        stream = (WrittenByThread if sys.platform == "win32" else NeverBlocking)(before.fileno())
    except (OSError, ValueError, AttributeError):  # standard error is in memory, closed or None
        yield
        return
    before.flush()
    sys.stderr = stream
    try:
        yield
    finally:
        sys.stderr = before
        stream.finish()


_captured = threading.Lock()


@contextmanager
def library_words() -> Iterator[list[str]]:
    """Collect the lines that C libraries, such as OpenCV's, print on standard error within the context.

    Yields
    ------
    list of str
        A list that is empty within the context, and contains the lines after the end of the context.
    """
    lines: list[str] = []
    with _captured, tempfile.TemporaryFile() as printed:
        before = os.dup(2)
        os.dup2(printed.fileno(), 2)
        try:
            yield lines
        finally:
            os.dup2(before, 2)
            os.close(before)
            printed.seek(0)
            lines += printed.read().decode("utf-8", "replace").splitlines()


def _reopened(descriptor: int) -> int:
    """Return a new descriptor for the same pipe, terminal or file; writes to a pipe or terminal then never block."""
    mode = os.fstat(descriptor).st_mode
    if sys.platform != "win32" and (stat.S_ISFIFO(mode) or stat.S_ISCHR(mode)):
        with suppress(OSError):
            # opened again: a change of the old descriptor would affect all processes that share it
            return os.open(f"/dev/fd/{descriptor}", os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY)
    return os.dup(descriptor)  # a file that is opened again would be written from its beginning
