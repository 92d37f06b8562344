r"""Record the messages on a line in a file, and play a recording back in place of the instrument.

Each line of the file is one event: the seconds since the first event, its kind, and the bytes in Python's escaped form.

    0.000000 open TCPIP::192.168.0.5::5025::SOCKET
    0.000213 > MEAS:CURR?\n
    0.012400 < 0.7001\n
    1.020113 <! InstrumentTimeout nothing came

The kind is ``>`` for sent bytes, ``<`` for read bytes, and ``>!`` or ``<!`` for an error in that direction. A lab can
attach such a file to a bug report.
"""

from __future__ import annotations

from pathlib import Path

from eimi_drivers import interfaces
from eimi_drivers.interfaces import Clock, InstrumentError
from eimi_drivers.supplies.transport import Transport


class TranscriptMismatch(AssertionError):
    """Report that the messages of a driver differ from the transcript."""


class RecordingTransport:
    """Record the messages of another transport; each event is on the disk before the next one."""

    def __init__(self, link: Transport, file: Path, clock: Clock) -> None:
        """Create the file, which must not exist. Raises OSError."""
        self.address = link.address
        self._link = link
        self._clock = clock
        self._began_s = clock.now()
        self._file = file.open("x", encoding="ascii", buffering=1)
        self._note("open", link.address.encode("unicode_escape").decode("ascii"))

    def _note(self, kind: str, text: str) -> None:
        print(f"{self._clock.now() - self._began_s:.6f} {kind} {text}", file=self._file)

    def _fault(self, kind: str, error: InstrumentError) -> None:
        self._note(kind, f"{type(error).__name__} {error}".encode("unicode_escape").decode("ascii"))

    def write(self, message: bytes) -> None:
        """See `Transport.write`."""
        self._note(">", escaped(message))
        try:
            self._link.write(message)
        except InstrumentError as error:
            self._fault(">!", error)
            raise

    def read(self, size: int, timeout_s: float, end: bytes = b"") -> bytes:
        """See `Transport.read`."""
        try:
            received = self._link.read(size, timeout_s, end)
        except InstrumentError as error:
            self._fault("<!", error)
            raise
        self._note("<", escaped(received))
        return received

    def reopen(self) -> bool:
        """See `Transport.reopen`."""
        self._note("open", self.address.encode("unicode_escape").decode("ascii"))
        return self._link.reopen()

    def close(self) -> None:
        """Close the line and the file."""
        self._link.close()
        self._file.close()


class ReplayedTransport:
    """Answer from a transcript without delay.

    A message that differs from the next one of the transcript raises TranscriptMismatch, and so does a read that the
    transcript does not contain. `assert_complete` reports events that did not happen. A recorded error is raised again.
    """

    def __init__(self, file: Path) -> None:
        """Read a transcript. Raises ValueError, which names the line that is no event."""
        self.address = ""
        self._events: list[tuple[int, str, str]] = []
        for number, line in enumerate(file.read_text(encoding="ascii").splitlines(), start=1):
            _, kind, text = [*line.split(" ", 2), "", ""][:3]
            if kind == "open":
                self.address = text
            elif kind in {">", "<", ">!", "<!"}:
                self._events.append((number, kind, text))
            else:
                raise ValueError(f"{file}: line {number}: {line!r} is no event; it should be open, >, <, >! or <!")
        self._next = 0

    def _take(self, kind: str, doing: str) -> tuple[int, str] | None:
        """Return line number and text of the next event; None if the event is of another kind."""
        if self._next == len(self._events):
            raise TranscriptMismatch(f"{doing} after the end of the transcript")
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
        """See `Transport.write`. Raises TranscriptMismatch."""
        doing = f"sent {escaped(message)}"
        before = self._next
        sent = self._take(">", doing)
        if sent is None or sent[1] != escaped(message):
            self._next = before
            raise self._mismatch(doing)
        self._raise_fault(">!")

    def read(self, size: int, timeout_s: float, end: bytes = b"") -> bytes:
        """See `Transport.read`. Raises TranscriptMismatch."""
        self._raise_fault("<!")
        received = self._take("<", f"read {size} bytes")
        if received is None:
            raise self._mismatch(f"read {size} bytes")
        return unescaped(received[1])

    def reopen(self) -> bool:
        """Return False: a transcript cannot be reopened."""
        return False

    def close(self) -> None:
        """Do nothing: there is no line to release."""

    def assert_complete(self) -> None:
        """Raise TranscriptMismatch if an event of the transcript did not happen."""
        if self._next < len(self._events):
            number, kind, text = self._events[self._next]
            count = len(self._events) - self._next
            raise TranscriptMismatch(f"{count} events never came, the first in line {number}: {kind} {text}")


def escaped(raw: bytes) -> str:
    """Return bytes as one line of ASCII text."""
    return raw.decode("latin-1").encode("unicode_escape").decode("ascii")


def unescaped(text: str) -> bytes:
    """Return the bytes of a text that `escaped` returned."""
    return text.encode("ascii").decode("unicode_escape").encode("latin-1")
