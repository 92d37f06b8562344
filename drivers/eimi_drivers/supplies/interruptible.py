"""Interrupt the exchange with an instrument between two messages, when no answer is expected."""

from __future__ import annotations

from collections.abc import Callable

from eimi_drivers.supplies.transport import Transport


class InterruptibleTransport:
    """Call a function before each message is sent over another transport.

    If the function raises an error, the message is not sent. The line can then be used again at once.

    Parameters
    ----------
    link : Transport
        The line.
    between_messages : callable
        The function that is called before each message.
    """

    def __init__(self, link: Transport, between_messages: Callable[[], None]) -> None:
        self.address = link.address
        self._link = link
        self._between_messages = between_messages

    def write(self, message: bytes) -> None:
        """See `Transport.write`."""
        self._between_messages()
        self._link.write(message)

    def read(self, size: int, timeout_s: float, end: bytes = b"") -> bytes:
        """See `Transport.read`."""
        return self._link.read(size, timeout_s, end)

    def reopen(self) -> bool:
        """See `Transport.reopen`."""
        return self._link.reopen()

    def close(self) -> None:
        """See `Transport.close`."""
        self._link.close()
