"""How bytes reach an instrument: a serial line, VISA, or an emulator in the same process.

Every failure of the operating system, of pyserial or of VISA comes out as one of the errors of
`eimi_drivers.interfaces`, with the address in the message and the original as its cause.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Protocol

import pyvisa
import serial

try:
    from termios import error as TerminalError
except ImportError:  # Windows has no termios, and pyserial does without it there
    TerminalError = OSError  # type: ignore[assignment,misc]

from eimi_drivers.interfaces import Clock, InstrumentDisconnected, InstrumentError, InstrumentTimeout

WRITE_TIMEOUT_S = 2.0
OPEN_TIMEOUT_S = 3.0

_CHANNEL = re.compile(r"(.*)#(\d{1,3})")


class Transport(Protocol):
    """A two-way stream of bytes to one instrument.

    address: as the rig file has it. A channel in it, `#2` at its end, is the driver's concern.
    """

    address: str

    def write(self, message: bytes) -> None:
        """Throw away what earlier questions left unread, then send the whole message."""

    def read(self, size: int, timeout_s: float, end: bytes = b"") -> bytes:
        """Read `size` bytes, or fewer when the byte `end` comes before.

        Raises InstrumentTimeout when neither has come within `timeout_s`.
        """

    def close(self) -> None:
        """Release the connection."""


def split_address(address: str) -> tuple[str, int | None]:
    """Where the instrument is, and the channel that `#2` at the end names; None without one."""
    match = _CHANNEL.fullmatch(address)
    return (match[1], int(match[2])) if match else (address, None)


def _no_answer(address: str, timeout_s: float, received: bytes = b"") -> InstrumentTimeout:
    found = f"only {received!r} came" if received else "nothing came"
    return InstrumentTimeout(f"{address}: no complete answer within {timeout_s:g} s ({found})")


class SerialTransport:
    """A serial port (8 data bits, no parity, 1 stop bit) through pyserial.

    The address is a port such as `/dev/ttyUSB0` or `COM3`, or a pyserial URL such as `socket://host:port`.
    The port is locked, so that two programs cannot talk to one supply at once.
    """

    def __init__(self, address: str, baud_rate: int = 9600) -> None:
        self.address = address
        with self._errors_named():
            self._port = serial.serial_for_url(
                split_address(address)[0],
                baudrate=baud_rate,
                timeout=0,
                write_timeout=WRITE_TIMEOUT_S,
                exclusive=True,
            )

    @contextmanager
    def _errors_named(self) -> Iterator[None]:
        try:
            yield
        except serial.SerialTimeoutException as error:
            raise InstrumentTimeout(f"{self.address}: the port takes no more bytes") from error
        except (OSError, TerminalError) as error:  # SerialException is an OSError; termios' own error is none
            raise InstrumentDisconnected(f"{self.address}: {error}") from error
        except ValueError as error:
            raise InstrumentError(f"{self.address}: {error}") from error

    def write(self, message: bytes) -> None:
        """See `Transport.write`."""
        with self._errors_named():
            # Not reset_input_buffer(): it raises termios.error, which is no OSError, on a port that is gone.
            while waiting := self._port.in_waiting:  # of a socket:// URL never more than 1
                self._port.read(waiting)
            self._port.write(message)

    def read(self, size: int, timeout_s: float, end: bytes = b"") -> bytes:
        """See `Transport.read`."""
        with self._errors_named():
            self._port.timeout = timeout_s
            received = bytes(self._port.read_until(end, size) if end else self._port.read(size))
        if len(received) < size and not (end and received.endswith(end)):
            raise _no_answer(self.address, timeout_s, received)
        return received

    def close(self) -> None:
        """Close the port; closing twice is allowed."""
        with self._errors_named():
            self._port.close()


def visa_library() -> str:
    """The VISA library to use, as PyVISA writes it."""
    return os.environ.get("PYVISA_LIBRARY", "@py")


class VisaTransport:
    """Any VISA resource through PyVISA, with its backend in Python, `@py`: no vendor library is needed.

    Where one is installed, the environment variable PYVISA_LIBRARY (PyVISA's own) chooses it: `@ivi`.
    `TCPIP::host::port::SOCKET`, `TCPIP::host::INSTR`, `USB0::…::INSTR` (needs PyUSB),
    `ASRL/dev/ttyUSB0::INSTR`; a bare serial port is taken as the last.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        place = split_address(address)[0]
        name = place if "::" in place else f"ASRL{place.removeprefix('COM')}::INSTR"
        try:
            self._resource: Any = pyvisa.ResourceManager(visa_library()).open_resource(
                name, open_timeout=round(OPEN_TIMEOUT_S * 1000)
            )
        except Exception as error:  # the backend raises bare Exception for a host that it cannot reach
            raise InstrumentDisconnected(f"{address}: cannot be opened: {error}") from error
        # Sockets and serial lines are streams: a late answer to an earlier question is still in there. The
        # other resources keep messages apart, and reading when nothing was asked is an error to them.
        self._is_stream = name.upper().startswith("ASRL") or name.upper().endswith("::SOCKET")
        try:
            self._discard_unread()  # a refused TCP connection shows at the first transfer, not at opening
        except InstrumentError:
            self.close()
            raise

    @contextmanager
    def _errors_named(self, timeout_s: float = WRITE_TIMEOUT_S) -> Iterator[None]:
        try:
            yield
        except pyvisa.errors.VisaIOError as error:
            if error.error_code == pyvisa.constants.StatusCode.error_timeout:
                raise _no_answer(self.address, timeout_s) from error
            raise InstrumentDisconnected(f"{self.address}: {error}") from error
        except (OSError, pyvisa.errors.Error) as error:
            raise InstrumentDisconnected(f"{self.address}: {error}") from error

    def _discard_unread(self) -> None:
        if not self._is_stream:
            return
        with self._errors_named():
            self._resource.timeout = 1  # milliseconds
            try:
                self._resource.read_bytes(65536)
            except pyvisa.errors.VisaIOError as error:
                if error.error_code != pyvisa.constants.StatusCode.error_timeout:
                    raise

    def write(self, message: bytes) -> None:
        """See `Transport.write`."""
        self._discard_unread()
        with self._errors_named():
            self._resource.timeout = round(WRITE_TIMEOUT_S * 1000)
            self._resource.write_raw(message)

    def read(self, size: int, timeout_s: float, end: bytes = b"") -> bytes:
        """See `Transport.read`."""
        with self._errors_named(timeout_s):
            self._resource.timeout = max(round(timeout_s * 1000), 1)
            self._resource.read_termination = end.decode("ascii") or None
            return bytes(self._resource.read_bytes(size, break_on_termchar=bool(end)))

    def close(self) -> None:
        """Close the resource; closing twice is allowed."""
        with self._errors_named():
            self._resource.close()


class Responder(Protocol):
    """What plays an instrument: takes bytes and answers with bytes (none where an instrument is silent)."""

    def receive(self, data: bytes) -> bytes:
        """Take what was sent and return the answer. Raises ConnectionError when the line is cut."""


class InProcessTransport:
    """Straight to an emulator in the same process; waiting takes the clock's time, not real time.

    sent: every message so far, the exact bytes.
    """

    def __init__(self, responder: Responder, clock: Clock, address: str = "in-process") -> None:
        self.address = address
        self.sent: list[bytes] = []
        self._responder = responder
        self._clock = clock
        self._unread = b""
        self._answered_after_s = 0.0

    def write(self, message: bytes) -> None:
        """See `Transport.write`."""
        self.sent.append(message)
        asked_s = self._clock.now()
        try:
            self._unread = self._responder.receive(message)
        except ConnectionError as error:
            raise InstrumentDisconnected(f"{self.address}: {error}") from error
        self._answered_after_s = self._clock.now() - asked_s

    def read(self, size: int, timeout_s: float, end: bytes = b"") -> bytes:
        """See `Transport.read`."""
        if self._answered_after_s > timeout_s:  # it came, but too late
            raise _no_answer(self.address, timeout_s)
        place = self._unread.find(end) if end else -1
        length = min(size, place + 1) if place >= 0 else size
        received, self._unread = self._unread[:length], self._unread[length:]
        if len(received) < length:
            self._clock.sleep(timeout_s)
            raise _no_answer(self.address, timeout_s, received)
        return received

    def close(self) -> None:
        """Nothing to release."""
