"""How bytes reach an instrument: a serial line, VISA, or an emulator in the same process.

Every failure of the operating system, of pyserial or of VISA comes out as one of the errors of
`eimi_drivers.interfaces`, with the address in the message and the original as its cause.
"""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import SimpleNamespace
from typing import Any, Protocol

import pyvisa
import serial

try:
    from termios import error as TerminalError
except ImportError:  # Windows has no termios, and pyserial does without it there
    TerminalError = OSError  # type: ignore[assignment,misc]

from eimi_drivers.interfaces import Clock, InstrumentDisconnected, InstrumentError, InstrumentTimeout

_sharing = False


def share_ports() -> None:
    """From here on this process opens ports that another one has locked: for one that has to switch off."""
    global _sharing
    _sharing = True


WRITE_TIMEOUT_S = 2.0
OPEN_TIMEOUT_S = 3.0

_VISA_SERIAL = re.compile(r"ASRL(.+?)(?:::INSTR)?", re.IGNORECASE)
_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*://")
SERIAL_URLS = ("socket://", "rfc2217://")
"""The pyserial URLs that are opened. Others can do other things: `spy://` overwrites the file that it is given."""
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

    def reopen(self) -> bool:
        """Close and open anew, for a line that has failed; False if it stays as it was. Raises InstrumentError.

        Whoever opens a line anew asks who is there: the address may lead to another instrument by then.
        """

    def close(self) -> None:
        """Release the connection."""


def split_address(address: str) -> tuple[str, int | None]:
    """Where the instrument is, and the channel that `#2` at the end names; None without one."""
    match = _CHANNEL.fullmatch(address)
    return (match[1], int(match[2])) if match else (address, None)


def usb_serial_number(address: str) -> str:
    """Return the serial number of the USB device that a serial port belongs to; "" if it has none or is no USB port."""
    from serial.tools import list_ports

    place = split_address(address)[0]
    visa = _VISA_SERIAL.fullmatch(place)
    port = visa[1] if visa else place
    name = f"COM{port}" if port.isdecimal() else os.path.realpath(port)
    if "://" in port or "::" in port or name.startswith("/dev/pts/"):
        return ""
    return next((str(found.serial_number or "") for found in list_ports.comports() if found.device == name), "")


def check_address(address: str) -> None:
    """Raise ValueError if an address is a URL of another kind than `SERIAL_URLS`."""
    place = split_address(address)[0]
    visa = _VISA_SERIAL.fullmatch(place)
    url = _URL.match(visa[1] if visa else place)
    if url and not url[0].lower().startswith(SERIAL_URLS):
        kinds = " or ".join(SERIAL_URLS)
        raise ValueError(f"{url[0]} is not opened; give a port such as /dev/ttyUSB0, or a URL with {kinds}")


def _no_answer(address: str, timeout_s: float, received: bytes = b"") -> InstrumentTimeout:
    found = f"only {received!r} came" if received else "nothing came"
    return InstrumentTimeout(f"{address}: no complete answer within {timeout_s:g} s ({found})")


class SerialTransport:
    """A serial port (8 data bits, no parity, 1 stop bit) through pyserial.

    The address is a port such as `/dev/ttyUSB0` or `COM3`, the same as VISA writes it (`ASRL/dev/ttyUSB0::INSTR`,
    `ASRL3::INSTR`), or a pyserial URL such as `socket://host:port`. The port is locked, so that two programs cannot
    talk to one supply at once.
    """

    def __init__(self, address: str, baud_rate: int = 9600) -> None:
        self.address = address
        self._baud_rate = baud_rate
        self._open()

    def _open(self) -> None:
        place = split_address(self.address)[0]
        visa = _VISA_SERIAL.fullmatch(place)
        port = visa[1] if visa else place
        with self._errors_named():
            check_address(self.address)
            self._port = serial.serial_for_url(
                f"COM{port}" if port.isdecimal() else port,
                baudrate=self._baud_rate,
                timeout=0,
                write_timeout=WRITE_TIMEOUT_S,
                exclusive=None if _sharing else True,
            )

    def reopen(self) -> bool:
        """See `Transport.reopen`. Not a pseudo-terminal: one that is gone may be another program's by now."""
        if "/dev/pts/" in self.address:
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
            raise InstrumentTimeout(f"{self.address}: the port takes no more bytes") from error
        except (OSError, TerminalError) as error:  # SerialException is an OSError; termios' own error is none
            raise InstrumentDisconnected(f"{self.address}: {error}") from error
        except (TypeError, AttributeError) as error:  # what pyserial raises on a port that it could not open anew
            raise InstrumentDisconnected(f"{self.address}: the port is not open") from error
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


def open_visa(address: str) -> Transport:
    """A VISA resource, or a bare serial port. Raises InstrumentError.

    A serial line needs no VISA where that is pyvisa-py, which does not lock it.
    """
    place = split_address(address)[0]
    is_serial = "::" not in place or _VISA_SERIAL.fullmatch(place) is not None
    return SerialTransport(address) if is_serial and visa_library() == "@py" else VisaTransport(address)


class VisaTransport:
    """Any VISA resource through PyVISA, with its backend in Python, `@py`: no vendor library is needed.

    Where one is installed, the environment variable PYVISA_LIBRARY (PyVISA's own) chooses it: `@ivi`.
    `TCPIP::host::port::SOCKET`, `TCPIP::host::INSTR`, `USB0::…::INSTR` (needs PyUSB). A line that has failed stays
    closed until `reopen`.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        self._failed = False
        self._open()

    def _open(self) -> None:
        place = split_address(self.address)[0]
        name = place if "::" in place else f"ASRL{place.removeprefix('COM')}::INSTR"
        if visa_library() == "@py":
            _wait_by_the_monotonic_clock()
        try:
            self._resource: Any = pyvisa.ResourceManager(visa_library()).open_resource(
                name, open_timeout=round(OPEN_TIMEOUT_S * 1000)
            )
        except Exception as error:  # the backend raises bare Exception for a host that it cannot reach
            raise InstrumentDisconnected(
                f"{self.address}: cannot be opened: {error or type(error).__name__}"
            ) from error
        # Sockets and serial lines are streams: a late answer to an earlier question is still in there. The
        # other resources keep messages apart, and reading when nothing was asked is an error to them.
        self._is_stream = name.upper().startswith("ASRL") or name.upper().endswith("::SOCKET")
        try:
            self._discard_unread()  # a refused TCP connection shows at the first transfer, not at opening
        except InstrumentError:
            with suppress(InstrumentError):
                self.close()
            raise
        self._failed = False

    def reopen(self) -> bool:
        """See `Transport.reopen`."""
        with suppress(InstrumentError):
            self.close()
        self._open()
        return True

    @contextmanager
    def _errors_named(self, timeout_s: float = WRITE_TIMEOUT_S) -> Iterator[None]:
        try:
            yield
        except InstrumentError:
            raise
        except pyvisa.errors.VisaIOError as error:
            if error.error_code == pyvisa.constants.StatusCode.error_timeout:
                raise _no_answer(self.address, timeout_s) from error
            self._failed = True
            raise InstrumentDisconnected(f"{self.address}: {error}") from error
        except Exception as error:  # a dropped HiSLIP link is a RuntimeError, VXI-11 has exceptions of its own
            self._failed = True
            raise InstrumentDisconnected(f"{self.address}: {error or type(error).__name__}") from error

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
        if self._failed:
            raise InstrumentDisconnected(f"{self.address}: the line was lost")
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


def _wait_by_the_monotonic_clock() -> None:
    """pyvisa-py ends its waits by the wall clock: one that is set back makes them last as much longer."""
    from pyvisa_py import sessions, tcpip
    from pyvisa_py.protocols import rpc

    for module in (sessions, tcpip, rpc):
        module.time = SimpleNamespace(time=time.monotonic, sleep=time.sleep)


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

    def reopen(self) -> bool:
        """See `Transport.reopen`. There is no other line."""
        return False

    def close(self) -> None:
        """Nothing to release."""
