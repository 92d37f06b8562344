"""Send a query to a sensor, and read one line of text within a time limit."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import ClassVar

from eimi_drivers.interfaces import (
    AnotherSensor,
    Clock,
    Identity,
    InstrumentDisconnected,
    ReplyNotUnderstood,
    SensorReading,
)
from eimi_drivers.supplies.address import is_serial_port
from eimi_drivers.supplies.identity import serial_number_in
from eimi_drivers.supplies.transport import SerialTransport, Transport
from eimi_drivers.supplies.visa import VisaTransport

LATE_ANSWER_S = 0.5
"""Wait (s) before a query if the previous query had no answer. An answer that arrives in this time is discarded."""

LONGEST_LINE = 256
IDENTITY = "*IDN?"


class SensorBase(ABC):
    """Base class of drivers for sensors that answer every query with one line of text.

    Parameters
    ----------
    link : Transport
        Serial, USB or network connection to the sensor.
    clock : Clock
        Clock for all waits: real or simulated time.

    Attributes
    ----------
    name : str
        Name of the driver.
    timeout_s : float
        Longest wait for an answer, s.
    baud_rate : int
        Speed of a serial connection, bit/s.
    data_bits : int
        Number of data bits, 7 or 8.
    parity : str
        "N" for none, "O" for odd, "E" for even.
    ends_with : bytes
        End of a query.
    """

    name: str
    timeout_s: float = 1.0
    baud_rate: ClassVar[int] = 9600
    data_bits: ClassVar[int] = 8
    parity: ClassVar[str] = "N"
    ends_with: ClassVar[bytes] = b"\n"

    def __init__(self, link: Transport, clock: Clock) -> None:
        self._link = link
        self._clock = clock
        self._unanswered = self._cut = self._unconfirmed = False
        self._bound: str | None = None

    @classmethod
    def connect(cls, address: str) -> Transport:
        """Open the serial port or the VISA resource, and return the connection."""
        if is_serial_port(address):
            return SerialTransport(address, cls.baud_rate, cls.data_bits, cls.parity)
        return VisaTransport(address)

    def identify(self) -> Identity:
        """Return the identity from the answer to ``*IDN?``.

        Raises AnotherSensor if the identity has changed since the driver was opened.
        """
        text = self._ask(IDENTITY).strip()
        if not text.isprintable() or not text:
            raise self._not_understood(IDENTITY, text, "a line of text")
        if self._bound is not None and text != self._bound:
            raise AnotherSensor(
                f"{self._link.address}: the sensor identifies itself as {text!r}, but earlier as {self._bound!r}; "
                "connect the sensor of this run again"
            )
        self._bound, self._unconfirmed = text, False
        return Identity(self.name, text, self._link.address, serial_number_in(text))

    @abstractmethod
    def read(self) -> SensorReading:
        """Return a new value of the sensor.

        Raises
        ------
        InstrumentTimeout
            No complete answer arrived within `timeout_s`.
        InstrumentDisconnected
            The connection was cut or closed.
        ReplyNotUnderstood
            The answer does not have the form that the manual of the sensor describes.
        """

    def close(self) -> None:
        """Release the connection. Closing twice is allowed."""
        self._link.close()

    def _reading(self, value: float, unit: str, standard_uncertainty: float | None = None) -> SensorReading:
        return SensorReading(value, unit, self._clock.now(), standard_uncertainty)

    def _ask(self, question: str) -> str:
        """Send a query, and return the answer as text without the end of the line."""
        if self._cut:
            if not self._link.reopen():
                raise InstrumentDisconnected(f"{self._link.address}: the connection was lost; check the sensor's cable")
            self._cut, self._unconfirmed = False, self._bound is not None
        if self._unconfirmed and question != IDENTITY:
            self.identify()
        try:
            return self._exchange(question)
        except InstrumentDisconnected:
            self._cut = True
            raise

    def _exchange(self, question: str) -> str:
        if self._unanswered:
            self._clock.sleep(LATE_ANSWER_S)
        self._unanswered = True
        self._link.write(question.encode("ascii") + self.ends_with)
        answer = self._link.read(LONGEST_LINE, self.timeout_s, b"\n")
        self._unanswered = False
        if not answer.endswith(b"\n"):
            raise self._not_understood(question, answer, "a line that ends")
        try:
            return answer.decode("ascii").rstrip("\r\n")
        except UnicodeDecodeError:
            raise self._not_understood(question, answer, "a line of text") from None

    def _number(self, question: str, text: str, example: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self._not_understood(question, text, f"a number such as {example}")
        return value

    def _not_understood(self, question: str, answer: bytes | str, expected: str) -> ReplyNotUnderstood:
        return ReplyNotUnderstood(
            f"{self._link.address}: the answer to {question} must be {expected}, but it is {answer!r}"
        )
