"""Write the messages to and from an instrument to the log, and a summary when the connection is closed."""

from __future__ import annotations

import logging

from eimi_drivers.interfaces import Clock, InstrumentError
from eimi_drivers.supplies.transport import Transport

_log = logging.getLogger(__name__)


def is_logged() -> bool:
    """Return whether the log records messages of the level INFO or DEBUG."""
    return _log.isEnabledFor(logging.INFO)


class LoggedTransport:
    """A connection to an instrument that writes every message to the log.

    `link` is the connection over which the messages are sent. `clock` measures the durations in the log.
    """

    def __init__(self, link: Transport, clock: Clock) -> None:
        self.address = link.address
        self._link = link
        self._clock = clock
        self._messages = self._answers = self._faults = self._reopened = 0
        self._sent_s = self._slowest_s = 0.0

    def write(self, message: bytes) -> None:
        """Log the message, discard all unread bytes, and send the message."""
        _log.debug("%s > %r", self.address, message)
        self._messages += 1
        self._sent_s = self._clock.now()
        try:
            self._link.write(message)
        except InstrumentError as error:
            self._fault(error)
            raise

    def read(self, size: int, timeout_s: float, end: bytes = b"") -> bytes:
        """Return and log the next bytes: at most `size` bytes, or the bytes up to and including `end`.

        Raises InstrumentTimeout if the bytes do not arrive within `timeout_s` (s).
        """
        try:
            received = self._link.read(size, timeout_s, end)
        except InstrumentError as error:
            self._fault(error)
            raise
        _log.debug("%s < %r", self.address, received)
        self._answers += 1
        self._slowest_s = max(self._slowest_s, self._clock.now() - self._sent_s)
        return received

    def reopen(self) -> bool:
        """Reopen the connection and log this; return False if the connection cannot be reopened."""
        self._reopened += 1
        _log.info("%s: the line is reopened", self.address)
        return self._link.reopen()

    def close(self) -> None:
        """Log the summary and release the connection."""
        _log.info(
            "%s: %d messages, %d answers, the slowest answer after %.3f s; %d faults, the line was reopened %d times",
            self.address,
            self._messages,
            self._answers,
            self._slowest_s,
            self._faults,
            self._reopened,
        )
        self._link.close()

    def _fault(self, error: InstrumentError) -> None:
        self._faults += 1
        _log.info("%s: %s: %s", self.address, type(error).__name__, error)
