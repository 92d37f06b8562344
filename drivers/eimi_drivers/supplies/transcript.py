r"""Record the messages to and from an instrument in a file, and play the file back without the instrument.

A line of the file contains time (s), kind and bytes or error, such as ``0.000213 > MEAS:CURR?\n``.
Kinds: ``open`` connection opened, ``>`` sent, ``<`` read, ``>!`` error while sending, ``<!`` error while reading.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from eimi_drivers import interfaces
from eimi_drivers.interfaces import Clock, InstrumentError
from eimi_drivers.supplies.transport import Transport


class TranscriptMismatch(AssertionError):
    """Report that a driver does not send or read the same messages as in the recording."""


class RecordingTransport:
    """A connection to an instrument that records all messages in a file.

    If the file cannot be written, for example because the disk is full, the recording ends. All messages are sent and
    read nevertheless, and `close` reports the error.
    """

    def __init__(self, link: Transport, file: Path, clock: Clock) -> None:
        """Create the file; raise OSError if the file exists or cannot be created."""
        self.address = link.address
        self._link = link
        self._clock = clock
        self._began_s = clock.now()
        self._path = file
        self._file = file.open("x", encoding="ascii", buffering=1)
        self._failed: OSError | None = None
        self._note("open", link.address.encode("unicode_escape").decode("ascii"))
        if self._failed:
            self._close_file()
            raise self._failed

    def _note(self, kind: str, text: str) -> None:
        if self._failed or self._file.closed:
            return
        try:
            print(f"{self._clock.now() - self._began_s:.6f} {kind} {text}", file=self._file)
        except OSError as error:  # the instrument must be switched off although its messages cannot be recorded
            self._failed = error

    def _fault(self, kind: str, error: InstrumentError) -> None:
        self._note(kind, f"{type(error).__name__} {error}".encode("unicode_escape").decode("ascii"))

    def write(self, message: bytes) -> None:
        """Record the message, discard all unread bytes, and send the message."""
        self._note(">", escaped(message))
        try:
            self._link.write(message)
        except InstrumentError as error:
            self._fault(">!", error)
            raise

    def read(self, size: int, timeout_s: float, end: bytes = b"") -> bytes:
        """Return and record the next bytes: at most `size` bytes, or the bytes up to and including `end`.

        Raises InstrumentTimeout if the bytes do not arrive within `timeout_s` (s).
        """
        try:
            received = self._link.read(size, timeout_s, end)
        except InstrumentError as error:
            self._fault("<!", error)
            raise
        self._note("<", escaped(received))
        return received

    def reopen(self) -> bool:
        """Record the reopening and reopen the connection; return False if the connection cannot be reopened."""
        self._note("open", self.address.encode("unicode_escape").decode("ascii"))
        return self._link.reopen()

    def close(self) -> None:
        """Release the connection and close the file. Raises InstrumentError if a message could not be recorded."""
        self._link.close()
        self._close_file()
        failed, self._failed = self._failed, None
        if failed:
            raise InstrumentError(f"{self._path}: later messages are not recorded: {failed.strerror}") from failed

    def _close_file(self) -> None:
        with suppress(OSError):
            self._file.close()


class ReplayedTransport:
    """A connection without an instrument, which plays recorded answers and errors back.

    If a driver does not send the recorded messages in their order, TranscriptMismatch is raised.
    """

    def __init__(self, file: Path) -> None:
        """Read the file with recorded messages; raise ValueError if a line has a wrong form."""
        self.address = ""
        self._events: list[tuple[int, str, str]] = []
        for number, line in enumerate(file.read_text(encoding="ascii").splitlines(), start=1):
            _, kind, text = [*line.split(" ", 2), "", ""][:3]
            if kind == "open":
                self.address = text
            elif kind in {">", "<", ">!", "<!"}:
                self._events.append((number, kind, text))
            else:
                raise ValueError(
                    f"{file}: line {number}: {line!r} is no event: its second word must be open, >, <, >! or <!"
                )
        self._next = 0

    def _take(self, kind: str, doing: str) -> tuple[int, str] | None:
        """Return line number and text of the next line in the recording if it has the given kind, else None."""
        if self._next == len(self._events):
            raise TranscriptMismatch(f"the driver wanted to {doing} after the end of the transcript")
        number, next_kind, text = self._events[self._next]
        if next_kind != kind:
            return None
        self._next += 1
        return number, text

    def _raise_fault(self, kind: str) -> None:
        if self._next < len(self._events) and (fault := self._take(kind, "")):
            name, _, message = fault[1].partition(" ")
            raise getattr(interfaces, name, InstrumentError)(message)

    def _mismatch(self, doing: str) -> TranscriptMismatch:
        number, kind, text = self._events[self._next]
        return TranscriptMismatch(f"{doing}, but line {number} of the transcript is: {kind} {text}")

    def write(self, message: bytes) -> None:
        """Compare the message with the next recorded message; raise TranscriptMismatch if they differ."""
        doing = f"sent {escaped(message)}"
        before = self._next
        sent = self._take(">", doing)
        if sent is None or sent[1] != escaped(message):
            self._next = before
            raise self._mismatch(doing)
        self._raise_fault(">!")

    def read(self, size: int, timeout_s: float, end: bytes = b"") -> bytes:
        """Return the next recorded answer of the instrument, or raise the next recorded error.

        Raises TranscriptMismatch if the recording continues with a sent message or ends.
        """
        self._raise_fault("<!")
        received = self._take("<", f"read {size} bytes")
        if received is None:
            raise self._mismatch(f"read {size} bytes")
        return unescaped(received[1])

    def reopen(self) -> bool:
        """Return False, because there is no instrument."""
        return False

    def close(self) -> None:
        """Do nothing, because there is no instrument."""

    def assert_complete(self) -> None:
        """Raise TranscriptMismatch if the recording was not played back to its end."""
        if self._next < len(self._events):
            number, kind, text = self._events[self._next]
            count = len(self._events) - self._next
            raise TranscriptMismatch(
                f"the program ended before the end of the transcript: {count} events did not happen, the first of "
                f"which is in line {number}: {kind} {text}"
            )


def escaped(raw: bytes) -> str:
    r"""Return bytes as one line of ASCII text with escape sequences such as ``\n``."""
    return raw.decode("latin-1").encode("unicode_escape").decode("ascii")


def unescaped(text: str) -> bytes:
    r"""Return the bytes that an ASCII text with escape sequences such as ``\n`` represents."""
    return text.encode("ascii").decode("unicode_escape").encode("latin-1")
