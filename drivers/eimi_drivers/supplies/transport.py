"""Send and receive bytes over a serial line, or to an emulated instrument in the same process.

Every error of the operating system is raised as an InstrumentError with the address.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Protocol

import serial

try:
    import termios
except ImportError:  # Windows has no termios, and pyserial does not need this module there
    termios = None  # type: ignore[assignment]

from eimi_drivers.interfaces import Clock, InstrumentDisconnected, InstrumentError, InstrumentTimeout, raised
from eimi_drivers.supplies.address import check_address, pseudo_terminal, serial_port

TerminalError: type[Exception] = getattr(termios, "error", OSError)
_sharing = False


def share_ports() -> None:
    """Let this process open serial ports that another process has locked."""
    global _sharing
    _sharing = True


WRITE_TIMEOUT_S = 2.0
POLL_EVERY_S = 0.002


class Transport(Protocol):
    """A serial, USB or network connection to one instrument."""

    address: str
    """The address in the rig file.

    A channel at the end of the address, such as ``#2``, is for the driver. The line ignores it.
    """

    def write(self, message: bytes) -> None:
        """Discard all unread bytes, then send the whole message."""

    def read(self, size: int, timeout_s: float, end: bytes = b"") -> bytes:
        """Return the next bytes from the instrument.

        Parameters
        ----------
        size : int
            Largest number of bytes.
        timeout_s : float
            Longest wait, s.
        end : bytes
            Byte at which the reading stops; empty if only `size` stops the reading.

        Raises
        ------
        InstrumentTimeout
            Neither `size` bytes nor the byte `end` arrived within `timeout_s`.
        """

    def reopen(self) -> bool:
        """Close a connection that has failed, and open it again; another instrument may then answer.

        Returns
        -------
        bool
            True if the connection is open again; False if this kind of connection is never reopened.

        Raises
        ------
        InstrumentError
            The connection could not be opened.
        """

    def close(self) -> None:
        """Release the connection."""


def no_answer(address: str, timeout_s: float, received: bytes | None = b"") -> InstrumentTimeout:
    """Return the error for an answer that is not complete within `timeout_s` (s).

    `received` is the beginning of the answer; None if it is not known.
    """
    detail = "" if received is None else f" (only {received!r} came)" if received else " (nothing came)"
    return InstrumentTimeout(f"{address}: no complete answer within {timeout_s:g} s{detail}")


class SerialTransport:
    """A connection to an instrument at a serial port, which may be reached over TCP.

    The port is locked against other programs.

    Parameters
    ----------
    address : str
        Port such as ``/dev/ttyUSB0``, ``COM3`` or ``ASRL3::INSTR``, or a serial line over TCP, such as
        ``socket://host:port``.
    baud_rate : int
        Speed of the line, bit/s.
    data_bits : int
        Number of data bits, 7 or 8.
    parity : str
        "N" for none, "O" for odd, "E" for even.
    stop_bits : int
        Number of stop bits, 1 or 2.
    """

    def __init__(
        self, address: str, baud_rate: int = 9600, data_bits: int = 8, parity: str = "N", stop_bits: int = 1
    ) -> None:
        self.address = address
        self._baud_rate, self._data_bits, self._parity, self._stop_bits = baud_rate, data_bits, parity, stop_bits
        self._open()

    def _open(self) -> None:
        port = serial_port(self.address)
        # A pseudo-terminal carries whole bytes and refuses another number of bits.
        is_terminal = pseudo_terminal(os.path.realpath(port)) != ""
        with self._errors_named():
            check_address(self.address)
            self._port = serial.serial_for_url(
                port,
                baudrate=self._baud_rate,
                bytesize=8 if is_terminal else self._data_bits,
                parity="N" if is_terminal else self._parity,
                stopbits=1 if is_terminal else self._stop_bits,
                timeout=0,
                write_timeout=WRITE_TIMEOUT_S,
                exclusive=None if _sharing else True,
            )

    def reopen(self) -> bool:
        """Close the port and open it again; return False for a pseudo-terminal, which is not reopened.

        Raises InstrumentError if the port cannot be opened.
        """
        if pseudo_terminal(self.address):
            return False
        with suppress(InstrumentError):
            self.close()
        self._open()
        return True

    @contextmanager
    def _errors_named(self) -> Iterator[None]:
        try:
            yield
        except serial.SerialTimeoutException as error:
            raise InstrumentTimeout(
                f"{self.address}: the serial port accepts no more bytes; is the instrument on?"
            ) from error
        except (OSError, TerminalError) as error:  # SerialException is an OSError; TerminalError is not
            raise InstrumentDisconnected(f"{self.address}: {error}") from error
        except (TypeError, AttributeError) as error:  # pyserial raises these errors if it could not reopen the port
            raise InstrumentDisconnected(f"{self.address}: the port is not open") from error
        except ValueError as error:
            raise InstrumentError(f"{self.address}: {error}") from error
        except InstrumentError:
            raise
        except Exception as error:  # a driver of the operating system below pyserial can raise any exception
            raise InstrumentDisconnected(f"{self.address}: {raised(error)}") from error

    def write(self, message: bytes) -> None:
        """Discard the unread bytes of the port, then send the whole message."""
        with self._errors_named():
            # reset_input_buffer() is not used, because it raises termios.error, not OSError, if the port has vanished.
            while waiting := self._port.in_waiting:  # at most 1 for a socket:// URL
                self._port.read(waiting)
            self._port.write(message)

    def read(self, size: int, timeout_s: float, end: bytes = b"") -> bytes:
        """Return the next bytes: at most `size` bytes, or the bytes up to and including `end`.

        Raises InstrumentTimeout if the bytes do not arrive within `timeout_s` (s).
        """
        with self._errors_named():
            if sys.platform == "win32":
                received = self._polled(size, timeout_s, end)
            else:
                self._port.timeout = timeout_s
                received = bytes(self._port.read_until(end, size) if end else self._port.read(size))
        if len(received) < size and not (end and received.endswith(end)):
            raise no_answer(self.address, timeout_s, received)
        return received

    def _polled(self, size: int, timeout_s: float, end: bytes) -> bytes:
        """Return the next bytes by asking the port every `POLL_EVERY_S` (s)."""
        # For Wine, which reports an error of the line if a long read has no answer in time.
        self._port.timeout = 0
        until = time.monotonic() + timeout_s
        received = b""
        while len(received) < size and not (end and received.endswith(end)):
            piece = bytes(self._port.read(1 if end else size - len(received)))
            if not piece and time.monotonic() >= until:
                break
            if not piece:
                time.sleep(POLL_EVERY_S)
            received += piece
        return received

    def close(self) -> None:
        """Close the port; closing twice is allowed."""
        with self._errors_named():
            self._port.close()


class Responder(Protocol):
    """An object that replaces an instrument: it receives messages and returns answers."""

    def receive(self, data: bytes) -> bytes:
        """Return the answer to a message, which may be empty; raise ConnectionError if the connection was cut."""


class InProcessTransport:
    """A connection to an emulated instrument in the same process.

    Parameters
    ----------
    responder : Responder
        Emulated instrument.
    clock : Clock
        Clock of the emulated instrument.
    address : str
        Address in messages.

    Attributes
    ----------
    sent : list of bytes
        All messages that were sent, in their order.
    """

    def __init__(self, responder: Responder, clock: Clock, address: str = "in-process") -> None:
        self.address = address
        self.sent: list[bytes] = []
        self._responder = responder
        self._clock = clock
        self._unread = b""
        self._answered_after_s = 0.0

    def write(self, message: bytes) -> None:
        """Discard the unread bytes, send the message to the emulated instrument, and store the answer."""
        self.sent.append(message)
        asked_s = self._clock.now()
        try:
            self._unread = self._responder.receive(message)
        except ConnectionError as error:
            raise InstrumentDisconnected(f"{self.address}: {error}") from error
        self._answered_after_s = self._clock.now() - asked_s

    def read(self, size: int, timeout_s: float, end: bytes = b"") -> bytes:
        """Return the next bytes of the stored answer: at most `size` bytes, or the bytes up to and including `end`.

        Raises InstrumentTimeout if the answer is too short or took longer than `timeout_s` (s).
        """
        if self._answered_after_s > timeout_s:  # the answer arrived too late
            raise no_answer(self.address, timeout_s)
        place = self._unread.find(end) if end else -1
        length = min(size, place + 1) if place >= 0 else size
        received, self._unread = self._unread[:length], self._unread[length:]
        if len(received) < length:
            self._clock.sleep(timeout_s)
            raise no_answer(self.address, timeout_s, received)
        return received

    def reopen(self) -> bool:
        """Return False, because this connection is never reopened."""
        return False

    def close(self) -> None:
        """Do nothing, because nothing is open."""
