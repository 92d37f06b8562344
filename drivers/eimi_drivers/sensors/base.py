"""Implement what all sensor drivers share: queries that are answered by one line of text within a time limit."""

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
from eimi_drivers.supplies.identity import serial_number_in
from eimi_drivers.supplies.transport import SerialTransport, Transport, VisaTransport, is_serial_port

LATE_ANSWER_S = 0.5
"""After a query without an answer the next query waits for this time, to discard a late answer."""

LONGEST_LINE = 256
IDENTITY = "*IDN?"


class SensorBase(ABC):
    """Read a sensor over a line on which every query has one line of text as its answer.

    A line that was cut is opened again by the next query, and the instrument is then identified before its values are
    used again.

    Parameters
    ----------
    link : Transport
        The line to the instrument. Nothing is sent when the sensor is opened.
    clock : Clock
        The clock of the rig.

    Attributes
    ----------
    name : str
        The name in a rig file.
    timeout_s : float
        The longest time until an answer, s.
    baud_rate, data_bits, parity
        The settings of a serial line.
    ends_with : bytes
        The end of a query. An answer ends with a line feed.
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
        """Open the serial port with the settings of the family, or another VISA resource."""
        if is_serial_port(address):
            return SerialTransport(address, cls.baud_rate, cls.data_bits, cls.parity)
        return VisaTransport(address)

    def identify(self) -> Identity:
        """Ask ``*IDN?``. Raises AnotherSensor if the answer differs from the previous answer."""
        text = self._ask(IDENTITY).strip()
        if not text.isprintable() or not text:
            raise self._not_understood(IDENTITY, text, "a line of text")
        if self._bound is not None and text != self._bound:
            raise AnotherSensor(
                f"{self._link.address}: the sensor identifies itself as {text!r}; it was {self._bound!r} before"
            )
        self._bound, self._unconfirmed = text, False
        return Identity(self.name, text, self._link.address, serial_number_in(text))

    @abstractmethod
    def read(self) -> SensorReading:
        """Ask for a new value. Raises InstrumentTimeout, InstrumentDisconnected, ReplyNotUnderstood."""

    def close(self) -> None:
        """Close the line; closing twice is allowed."""
        self._link.close()

    def _reading(self, value: float, unit: str, standard_uncertainty: float | None = None) -> SensorReading:
        return SensorReading(value, unit, self._clock.now(), standard_uncertainty)

    def _ask(self, question: str) -> str:
        """Send a query and return its answer without the end of the line."""
        if self._cut:
            if not self._link.reopen():
                raise InstrumentDisconnected(f"{self._link.address}: the line was cut")
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
        return ReplyNotUnderstood(f"{self._link.address}: {question} was answered with {answer!r}, not with {expected}")
