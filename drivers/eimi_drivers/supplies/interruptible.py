"""Call a function before each message to an instrument; the function may stop the exchange of messages."""

from __future__ import annotations

from collections.abc import Callable

from eimi_drivers.supplies.transport import Transport


class InterruptibleTransport:
    """A connection to an instrument that calls a function before it sends each message.

    If the function raises an error, the message is not sent.

    Parameters
    ----------
    link : Transport
        Connection over which the messages are sent.
    between_messages : callable
        Function without arguments that is called before each message.
    """

    def __init__(self, link: Transport, between_messages: Callable[[], None]) -> None:
        self.address = link.address
        self._link = link
        self._between_messages = between_messages

    def write(self, message: bytes) -> None:
        """Call `between_messages`, then send the message."""
        self._between_messages()
        self._link.write(message)

    def read(self, size: int, timeout_s: float, end: bytes = b"") -> bytes:
        """Return the next bytes from the instrument: at most `size` bytes, or the bytes up to and including `end`.

        Raises InstrumentTimeout if the bytes do not arrive within `timeout_s` (s).
        """
        return self._link.read(size, timeout_s, end)

    def reopen(self) -> bool:
        """Reopen the connection; return False if the connection cannot be reopened."""
        return self._link.reopen()

    def close(self) -> None:
        """Release the connection."""
        self._link.close()
