"""What went over the wire, written down as it happened, and played back in place of the instrument.

A line an event: seconds since the first, what it was, and the bytes as Python escapes them.

    0.000000 open TCPIP::192.168.0.5::5025::SOCKET
    0.000213 > MEAS:CURR?\\n
    0.012400 < 0.7001\\n
    1.020113 <! InstrumentTimeout nothing came

`>` is what was sent, `<` what was read, `>!` and `<!` the errors of either. So a lab can send us what its supply said.
"""

from __future__ import annotations

from pathlib import Path

from eimi_drivers import interfaces
from eimi_drivers.interfaces import Clock, InstrumentError
from eimi_drivers.supplies.transport import Transport


class TranscriptMismatch(AssertionError):
    """What a driver does is not what the transcript holds."""


class RecordingTransport:
    """A transport that writes down what goes over another one, each event on the disk before the next."""

    def __init__(self, link: Transport, file: Path, clock: Clock) -> None:
        """Begin a new file. Raises OSError."""
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
        """Close both."""
        self._link.close()
        self._file.close()


class ReplayedTransport:
    """A transport that answers from a transcript, in no time.

    Raises TranscriptMismatch for a message that differs from the transcript's next, and for a read that it does not
    hold; `assert_complete` for what is left over. A fault that it holds is raised again.
    """

    def __init__(self, file: Path) -> None:
        """Read a transcript. Raises ValueError naming a line that is none."""
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
        """Line and text of the next event where it is of that kind."""
        if self._next == len(self._events):
            raise TranscriptMismatch(f"{doing} after the end of the transcript")
        number, found, text = self._events[self._next]
        if found != kind:
            return None
        self._next += 1
        return number, text

    def _raise_fault(self, kind: str) -> None:
        if self._next < len(self._events) and (fault := self._take(kind, "")):
            name, _, message = fault[1].partition(" ")
            raise getattr(interfaces, name, InstrumentError)(message)

    def _mismatch(self, doing: str) -> TranscriptMismatch:
        number, kind, text = self._events[self._next]
        return TranscriptMismatch(f"{doing} where line {number} of the transcript is: {kind} {text}")

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
        """See `Transport.reopen`. There is no other line."""
        return False

    def close(self) -> None:
        """Nothing to release."""

    def assert_complete(self) -> None:
        """Raise TranscriptMismatch where something of the transcript never happened."""
        if self._next < len(self._events):
            number, kind, text = self._events[self._next]
            left = len(self._events) - self._next
            raise TranscriptMismatch(f"{left} events never came, the first in line {number}: {kind} {text}")


def escaped(raw: bytes) -> str:
    """Bytes on one line of ASCII."""
    return raw.decode("latin-1").encode("unicode_escape").decode("ascii")


def unescaped(text: str) -> bytes:
    """The inverse of `escaped`."""
    return text.encode("ascii").decode("unicode_escape").encode("latin-1")
