r"""Record the messages on a line in a file, and play a recording back in place of the instrument.

Each line of the file is one event. The line contains the time since the first event (s), the kind of the event, and the
bytes as text with Python's escape sequences.

    0.000000 open TCPIP::192.168.0.5::5025::SOCKET
    0.000213 > MEAS:CURR?\n
    0.012400 < 0.7001\n
    1.020113 <! InstrumentTimeout nothing came

The kind is ``>`` for sent bytes, ``<`` for read bytes, ``>!`` for an error while sending and ``<!`` for an error while
reading. The kind ``open`` is followed by the address of the instrument. Such a file can be attached to a bug report.
"""

from __future__ import annotations

from pathlib import Path

from eimi_drivers import interfaces
from eimi_drivers.interfaces import Clock, InstrumentError
from eimi_drivers.supplies.transport import Transport


class TranscriptMismatch(AssertionError):
    """Report that a driver sends another message than the recorded one, or reads where no answer was recorded."""


class RecordingTransport:
    """A line (a connection to an instrument) that writes its messages to a transcript file.

    Each event is written to the file before the next message is sent or read.
    """

    def __init__(self, link: Transport, file: Path, clock: Clock) -> None:
        """Create the transcript file. Raises OSError if the file exists or cannot be created."""
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
        """Record the message, discard all unread bytes of the connection, and send the message."""
        self._note(">", escaped(message))
        try:
            self._link.write(message)
        except InstrumentError as error:
            self._fault(">!", error)
            raise

    def read(self, size: int, timeout_s: float, end: bytes = b"") -> bytes:
        """Return and record the next bytes from the instrument: at most `size`, or the bytes up to and including `end`.

        Raises InstrumentTimeout if neither `size` bytes nor `end` arrive within `timeout_s` (s).
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
        """Release the connection and close the transcript file."""
        self._link.close()
        self._file.close()


class ReplayedTransport:
    """A connection without an instrument, which answers at once from a transcript, a file with recorded messages.

    The driver must send the same messages as in the recording, in the same order. Otherwise TranscriptMismatch is
    raised. An error that was recorded is raised again. `assert_complete` checks that the whole transcript was played
    back.
    """

    def __init__(self, file: Path) -> None:
        """Read the transcript file. Raises ValueError if a line of the file is not an event."""
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
        """Return the next event of the transcript (line number and text) if it is of the expected kind, and go past it.

        Parameters
        ----------
        kind : str
            The expected kind: ">" for sent bytes, "<" for read bytes, ">!" for an error while sending, or "<!" for an
            error while reading.
        doing : str
            A description of the driver's action, for the message.

        Returns
        -------
        tuple of (int, str) or None
            None if the next event is of another kind; it then stays the next event.

        Raises
        ------
        TranscriptMismatch
            The transcript has no further event.
        """
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
        """Compare the message with the next event of the transcript. Raises TranscriptMismatch if the two differ."""
        doing = f"sent {escaped(message)}"
        before = self._next
        sent = self._take(">", doing)
        if sent is None or sent[1] != escaped(message):
            self._next = before
            raise self._mismatch(doing)
        self._raise_fault(">!")

    def read(self, size: int, timeout_s: float, end: bytes = b"") -> bytes:
        """Return the recorded answer of the instrument that comes next in the transcript.

        If an error comes next that was recorded while reading, this error is raised again. TranscriptMismatch is raised
        if neither an answer nor such an error comes next.
        """
        self._raise_fault("<!")
        received = self._take("<", f"read {size} bytes")
        if received is None:
            raise self._mismatch(f"read {size} bytes")
        return unescaped(received[1])

    def reopen(self) -> bool:
        """Return False: a transcript (a file of recorded messages) has no connection that could be reopened."""
        return False

    def close(self) -> None:
        """Do nothing, because no connection is open."""

    def assert_complete(self) -> None:
        """Raise TranscriptMismatch if the transcript (the file of recorded messages) was not played back to its end."""
        if self._next < len(self._events):
            number, kind, text = self._events[self._next]
            count = len(self._events) - self._next
            raise TranscriptMismatch(
                f"{count} events of the transcript never happened, the first of which is in line {number}: {kind} "
                f"{text}"
            )


def escaped(raw: bytes) -> str:
    r"""Return bytes as one line of ASCII text, in which escape sequences such as ``\n`` replace other bytes."""
    return raw.decode("latin-1").encode("unicode_escape").decode("ascii")


def unescaped(text: str) -> bytes:
    r"""Return the bytes that an ASCII text with escape sequences of Python, such as ``\n``, stands for."""
    return text.encode("ascii").decode("unicode_escape").encode("latin-1")
