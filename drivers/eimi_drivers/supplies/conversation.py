"""Send queries to a supply, check the form of the answers, and check that the same supply always answers."""

from __future__ import annotations

from typing import ClassVar

from eimi_drivers.interfaces import AnotherSupply, Clock, Identity, InstrumentDisconnected, ReplyNotUnderstood
from eimi_drivers.supplies.address import usb_serial_number
from eimi_drivers.supplies.identity import in_words, serial_number_in
from eimi_drivers.supplies.transport import Transport
from eimi_drivers.supplies.values import line_in, number_in

REPLY_TIMEOUT_S = 1.0
LATE_ANSWER_S = 1.0
"""Time (s) after the timeout of a query within which a late answer is expected and discarded."""


class Conversation:
    """The queries to one supply, its answers, and its identity.

    Parameters
    ----------
    link : Transport
        Serial, USB or network connection to the supply.
    clock : Clock
        Clock for all waits: real or simulated time.

    Attributes
    ----------
    name : str
        Name of the driver.
    """

    name: ClassVar[str]

    def __init__(self, link: Transport, clock: Clock) -> None:
        self._link = link
        self._clock = clock
        self._unanswered = False
        self._late_until_s = 0.0
        self._bound: Identity | None = None
        self._unconfirmed = False  # True after a reopening of the line, until the instrument is identified again

    def _question(self, message: bytes, size: int, end: bytes = b"", pause_s: float = 0.0) -> bytes:
        """Send a query, wait `pause_s` (s), and return the answer: `size` bytes, or the bytes up to the byte `end`."""
        if self._unanswered and (remaining_s := self._late_until_s - self._clock.now()) > 0:
            self._clock.sleep(remaining_s)  # a late answer must not be taken for the next answer
        self._link.write(message)
        self._clock.sleep(pause_s)
        self._unanswered = True
        self._late_until_s = self._clock.now() + REPLY_TIMEOUT_S + LATE_ANSWER_S
        try:
            reply = self._link.read(size, REPLY_TIMEOUT_S, end)
        except InstrumentDisconnected:
            self._late_until_s -= REPLY_TIMEOUT_S
            raise
        self._unanswered = False
        return reply

    def _number(self, question: str, reply: bytes) -> float:
        if (number := number_in(reply)) is None:
            raise self._not_understood(question, reply, "a number")
        return number

    def _identity(self, reply: bytes) -> Identity:
        text = self._line("*IDN?", reply)
        return self._bind(text, serial_number_in(text))

    def _line(self, question: str, reply: bytes) -> str:
        text = line_in(reply)
        if text is None or text == question:  # the answer equals the query if the line only echoes messages
            raise self._not_understood(question, reply, "a line of text")
        return text

    def _bind(self, text: str, serial_number: str) -> Identity:
        """Return the identity of the supply; raise AnotherSupply if it differs from the first identity."""
        address = self._link.address
        identity = Identity(self.name, text, address, serial_number or usb_serial_number(address))
        self._bound = self._bound or identity
        if self._bound != identity:
            raise AnotherSupply(
                f"{address}: the coil's supply is not there: {in_words(identity)} answers instead of "
                f"{in_words(self._bound)}"
            )
        self._unconfirmed = False
        return identity

    def _not_understood(self, question: str, reply: bytes, expected: str) -> ReplyNotUnderstood:
        return ReplyNotUnderstood(
            f"{self._link.address}: the answer to {question} must be {expected}, but it is {reply!r}"
        )
