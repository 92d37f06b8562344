"""Exchange bytes with an instrument over a serial line, over VISA, or with an emulator in the same process.

Every error of the operating system, of pyserial or of VISA is raised as an error of `eimi_drivers.interfaces`. The
message of the raised error contains the address. The original error is the cause of the raised error.
"""

from __future__ import annotations

import logging
import os
import re
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import SimpleNamespace
from typing import Any, Protocol

import pyvisa
import serial

try:
    import termios
except ImportError:  # Windows has no termios, and pyserial does not need this module there
    termios = None  # type: ignore[assignment]

from eimi_drivers.interfaces import Clock, InstrumentDisconnected, InstrumentError, InstrumentTimeout, raised
from eimi_drivers.serial_ports import attached_ports

_log = logging.getLogger(__name__)

TerminalError: type[Exception] = getattr(termios, "error", OSError)
_sharing = False


def share_ports() -> None:
    """Let this process open ports that another process has locked.

    The guardian calls this function. The guardian is a process that watches a measurement and switches the supply off
    if the process of the measurement no longer responds. That process may still have the port locked.
    """
    global _sharing
    _sharing = True


WRITE_TIMEOUT_S = 2.0
OPEN_TIMEOUT_S = 3.0
POLL_EVERY_S = 0.002

_VISA_SERIAL = re.compile(r"ASRL(.+?)(?:::INSTR)?", re.IGNORECASE)
_VISA_SOCKET = re.compile(r"TCPIP\d*::([^:]+)::(\d+)::SOCKET", re.IGNORECASE)
_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*://")
SERIAL_URLS = ("socket://", "rfc2217://")
"""The permitted pyserial URLs. Other URLs can do harm: ``spy://`` overwrites the file in the URL."""
_CHANNEL = re.compile(r"(.*)#(\d{1,3})")


class Transport(Protocol):
    """A line: a serial, USB or network connection that carries bytes to and from one instrument."""

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
            The largest number of bytes.
        timeout_s : float
            The longest wait, s.
        end : bytes
            The byte that ends the answer, which may then be shorter than `size`. Empty if only `size` ends the answer.

        Raises
        ------
        InstrumentTimeout
            Neither `size` bytes nor the byte `end` arrived within `timeout_s`.
        """

    def reopen(self) -> bool:
        """Close a line that has failed, and open it again.

        The address may meanwhile lead to another instrument. The caller must therefore ask for the identity again.

        Returns
        -------
        bool
            True if the line is open again; False if a line of this kind is never reopened.

        Raises
        ------
        InstrumentError
            The line could not be opened.
        """

    def close(self) -> None:
        """Release the connection."""


def split_address(address: str) -> tuple[str, int | None]:
    """Return an address without its channel, and the number of the channel.

    For an address that ends in ``#2`` the channel is 2. If the address contains no channel, the number is None.
    """
    match = _CHANNEL.fullmatch(address)
    return (match[1], int(match[2])) if match else (address, None)


def usb_serial_number(address: str) -> str:
    """Return the serial number of the USB adapter or instrument to which a serial port belongs.

    The result is empty if the USB device has no serial number, if the port does not belong to a USB device, or if the
    serial ports cannot be listed.
    """
    port = serial_port(address)
    name = os.path.realpath(port) if port.startswith("/") else port.upper()
    if not name.startswith(("/", "COM")) or name.startswith("/dev/pts/"):
        return ""
    try:
        devices = attached_ports()
    except Exception as error:  # without a serial number the supply counts as a supply that cannot be identified
        _log.info("the serial ports cannot be listed: %s", raised(error))
        return ""
    return next((str(device.serial_number or "") for device in devices if device.device == name), "")


def serial_port(address: str) -> str:
    """Return the name under which pyserial opens an address: a port, or a VISA resource of a serial port or socket."""
    place = split_address(address)[0].removeprefix("\\\\.\\")  # Windows prefix of COM10 and above; pyserial adds it
    if match := _VISA_SERIAL.fullmatch(place):
        return f"COM{match[1]}" if match[1].isdecimal() else match[1]
    match = _VISA_SOCKET.fullmatch(place)
    return f"socket://{match[1]}:{match[2]}" if match else place


def check_address(address: str) -> None:
    """Raise ValueError if an address is a URL that does not begin with one of `SERIAL_URLS`."""
    url = _URL.match(serial_port(address))
    if url and not url[0].lower().startswith(SERIAL_URLS):
        kinds = " or ".join(SERIAL_URLS)
        raise ValueError(
            f"{url[0]} is not supported; give a port such as /dev/ttyUSB0, or a URL that begins with {kinds}"
        )


def _no_answer(address: str, timeout_s: float, received: bytes = b"") -> InstrumentTimeout:
    detail = f"only {received!r} came" if received else "nothing came"
    return InstrumentTimeout(f"{address}: no complete answer within {timeout_s:g} s ({detail})")


class SerialTransport:
    """A line to an instrument at a serial port, or at a serial port that is reached over TCP.

    pyserial opens the port. The port is locked, so that two programs cannot use one instrument at the same time.

    Parameters
    ----------
    address : str
        A port such as ``/dev/ttyUSB0`` or ``COM3``, a port in the notation of VISA (``ASRL/dev/ttyUSB0::INSTR``,
        ``ASRL3::INSTR``), or a serial line over TCP, such as ``socket://host:port`` or ``TCPIP::host::port::SOCKET``.
    baud_rate : int
        The speed of the line, bit/s.
    data_bits : int
        The number of data bits, 7 or 8.
    parity : str
        "N" for none, "O" for odd, "E" for even.
    stop_bits : int
        The number of stop bits, 1 or 2.
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
        is_terminal = os.path.realpath(port).startswith("/dev/pts/")
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
        """Close the port and open it again. Raises InstrumentError if the port cannot be opened.

        Returns True if the port is open again. Returns False for a pseudo-terminal, which is not reopened because its
        name may belong to another program.
        """
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
        """Return the next bytes from the port: at most `size` bytes, or the bytes up to and including `end`.

        Raises InstrumentTimeout if neither `size` bytes nor `end` arrive within `timeout_s` (s).
        """
        with self._errors_named():
            if sys.platform == "win32":
                received = self._polled(size, timeout_s, end)
            else:
                self._port.timeout = timeout_s
                received = bytes(self._port.read_until(end, size) if end else self._port.read(size))
        if len(received) < size and not (end and received.endswith(end)):
            raise _no_answer(self.address, timeout_s, received)
        return received

    def _polled(self, size: int, timeout_s: float, end: bytes) -> bytes:
        """Return the next bytes from the port, which are read without blocking in intervals of `POLL_EVERY_S` (s).

        The bytes may be fewer than `size` if the time `timeout_s` (s) has passed. This method is for Wine, which
        reports a blocking read that times out as an error of the line.
        """
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


def visa_library() -> str:
    """Return the VISA library in PyVISA's notation: the environment variable PYVISA_LIBRARY, by default ``@py``."""
    return os.environ.get("PYVISA_LIBRARY", "@py")


def is_serial_port(address: str) -> bool:
    """Return whether an address is a VISA resource of a serial port or, without ``::``, the name of a serial port."""
    place = split_address(address)[0]
    return "::" not in place or _VISA_SERIAL.fullmatch(place) is not None


def open_visa(address: str, baud_rate: int = 9600, stop_bits: int = 1) -> Transport:
    """Open a VISA resource or a serial port and return the line.

    pyvisa-py does not lock serial ports. If pyvisa-py is the VISA library, a serial port is opened with pyserial.

    Parameters
    ----------
    address : str
        A VISA resource or the name of a serial port.
    baud_rate : int
        The speed of a serial line that pyserial opens, bit/s.
    stop_bits : int
        The number of stop bits on a serial line that pyserial opens.

    Raises
    ------
    InstrumentError
        The address cannot be opened.
    """
    is_serial = is_serial_port(address)
    if is_serial and visa_library() == "@py":
        return SerialTransport(address, baud_rate, stop_bits=stop_bits)
    return VisaTransport(address)


class VisaTransport:
    """A line to an instrument that PyVISA opens as a VISA resource.

    The default VISA library is pyvisa-py (``@py``), which needs no software of the instrument's maker. The environment
    variable PYVISA_LIBRARY selects another library, such as ``@ivi``. A line that has failed can be used again only
    after `reopen`.

    Parameters
    ----------
    address : str
        A resource such as ``TCPIP::host::port::SOCKET``, ``TCPIP::host::INSTR`` or ``USB0::…::INSTR`` (needs PyUSB).
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
        except Exception as error:  # pyvisa-py raises a bare Exception for an unreachable host
            raise InstrumentDisconnected(
                f"{self.address}: cannot be opened: {error or type(error).__name__}"
            ) from error
        # Sockets and serial lines are streams, in which a late answer to an earlier query remains. The other resources
        # separate messages, and a read without a query is an error for them.
        self._is_stream = name.upper().startswith("ASRL") or name.upper().endswith("::SOCKET")
        try:
            self._discard_unread()  # a refused TCP connection is reported only at the first transfer of bytes
        except InstrumentError:
            with suppress(InstrumentError):
                self.close()
            raise
        self._failed = False

    def reopen(self) -> bool:
        """Close the resource, open the resource again and return True. Raises InstrumentError if opening fails."""
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
        except Exception as error:  # HiSLIP raises RuntimeError, VXI-11 its own exceptions
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
        """Discard the unread bytes of a socket or a serial line, then send the whole message."""
        if self._failed:
            raise InstrumentDisconnected(f"{self.address}: the connection was lost; check the cable of the instrument")
        self._discard_unread()
        with self._errors_named():
            self._resource.timeout = round(WRITE_TIMEOUT_S * 1000)
            self._resource.write_raw(message)

    def read(self, size: int, timeout_s: float, end: bytes = b"") -> bytes:
        """Return the next bytes from the resource: at most `size` bytes, or the bytes up to and including `end`.

        Raises InstrumentTimeout if neither `size` bytes nor `end` arrive within `timeout_s` (s).
        """
        with self._errors_named(timeout_s):
            self._resource.timeout = max(round(timeout_s * 1000), 1)
            self._resource.read_termination = end.decode("ascii") or None
            return bytes(self._resource.read_bytes(size, break_on_termchar=bool(end)))

    def close(self) -> None:
        """Close the resource; closing twice is allowed."""
        with self._errors_named():
            self._resource.close()


def _wait_by_the_monotonic_clock() -> None:
    """Make pyvisa-py measure its timeouts with the monotonic clock.

    Without this change pyvisa-py uses the wall clock. If a person sets the wall clock back, a timeout becomes longer by
    the same time.
    """
    from pyvisa_py import sessions, tcpip
    from pyvisa_py.protocols import rpc

    for module in (sessions, tcpip, rpc):
        module.time = SimpleNamespace(time=time.monotonic, sleep=time.sleep)


class Responder(Protocol):
    """An object that replaces an instrument: the object receives bytes and returns the answer as bytes."""

    def receive(self, data: bytes) -> bytes:
        """Receive a message and return the answer, which may be empty. Raises ConnectionError if the line is cut."""


class InProcessTransport:
    """A line to an emulator in the same process. All waits use the clock of the emulator.

    Parameters
    ----------
    responder : Responder
        The emulator.
    clock : Clock
        The clock of the emulator.
    address : str
        The address that appears in messages.

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
        """Discard the unread bytes, give the message to the emulator and store the answer."""
        self.sent.append(message)
        asked_s = self._clock.now()
        try:
            self._unread = self._responder.receive(message)
        except ConnectionError as error:
            raise InstrumentDisconnected(f"{self.address}: {error}") from error
        self._answered_after_s = self._clock.now() - asked_s

    def read(self, size: int, timeout_s: float, end: bytes = b"") -> bytes:
        """Return the next bytes of the stored answer: at most `size` bytes, or the bytes up to and including `end`.

        Raises InstrumentTimeout if the stored answer has neither `size` bytes nor `end`, or arrives after `timeout_s`
        (s).
        """
        if self._answered_after_s > timeout_s:  # the answer arrived too late
            raise _no_answer(self.address, timeout_s)
        place = self._unread.find(end) if end else -1
        length = min(size, place + 1) if place >= 0 else size
        received, self._unread = self._unread[:length], self._unread[length:]
        if len(received) < length:
            self._clock.sleep(timeout_s)
            raise _no_answer(self.address, timeout_s, received)
        return received

    def reopen(self) -> bool:
        """Return False, because the line to an emulator in the same process cannot be reopened."""
        return False

    def close(self) -> None:
        """Do nothing, because an emulator in the same process needs no connection."""
