"""Send and receive bytes over VISA.

Every error of VISA is raised as an InstrumentError with the address.
"""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import SimpleNamespace
from typing import Any

from eimi_drivers.interfaces import InstrumentDisconnected, InstrumentError
from eimi_drivers.supplies.address import is_serial_port, split_address
from eimi_drivers.supplies.transport import WRITE_TIMEOUT_S, SerialTransport, Transport, no_answer

OPEN_TIMEOUT_S = 3.0


def visa_library() -> str:
    """Return the VISA library in PyVISA's notation: the environment variable PYVISA_LIBRARY, by default ``@py``."""
    return os.environ.get("PYVISA_LIBRARY", "@py")


def open_visa(address: str, baud_rate: int = 9600, stop_bits: int = 1) -> Transport:
    """Open a VISA resource or a serial port and return the connection.

    Parameters
    ----------
    address : str
        VISA resource or name of a serial port.
    baud_rate : int
        Speed of a serial line, bit/s; ignored if VISA opens the line.
    stop_bits : int
        Number of stop bits on a serial line; ignored if VISA opens the line.

    Raises
    ------
    InstrumentError
        The address cannot be opened.
    """
    is_serial = is_serial_port(address)
    if is_serial and visa_library() == "@py":  # pyvisa-py does not lock serial ports
        return SerialTransport(address, baud_rate, stop_bits=stop_bits)
    return VisaTransport(address)


def load_visa(address: str) -> None:
    """Load the VISA library that `open_visa` needs for this address; errors are ignored."""
    if not is_serial_port(address) or visa_library() != "@py":
        with suppress(Exception):  # a VISA library can raise any exception
            import pyvisa

            pyvisa.ResourceManager(visa_library())


class VisaTransport:
    """A connection to an instrument that PyVISA opens as a VISA resource.

    Parameters
    ----------
    address : str
        Resource such as ``TCPIP::host::port::SOCKET``, ``TCPIP::host::INSTR`` or ``USB0::…::INSTR`` (needs PyUSB).
    """

    def __init__(self, address: str) -> None:
        self.address = address
        self._failed = False
        self._open()

    def _open(self) -> None:
        import pyvisa

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
        if visa_library() == "@py" and name.upper().endswith("::SOCKET"):
            _send_at_once(self._resource)
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
        """Close the resource, open it again and return True; raise InstrumentError if opening fails."""
        with suppress(InstrumentError):
            self.close()
        self._open()
        return True

    @contextmanager
    def _errors_named(self, timeout_s: float = WRITE_TIMEOUT_S) -> Iterator[None]:
        import pyvisa

        try:
            yield
        except InstrumentError:
            raise
        except pyvisa.errors.VisaIOError as error:
            if error.error_code == pyvisa.constants.StatusCode.error_timeout:
                raise no_answer(self.address, timeout_s, None) from error  # PyVISA discards what came
            self._failed = True
            raise InstrumentDisconnected(f"{self.address}: {error}") from error
        except Exception as error:  # HiSLIP raises RuntimeError, VXI-11 its own exceptions
            self._failed = True
            raise InstrumentDisconnected(f"{self.address}: {error or type(error).__name__}") from error

    def _discard_unread(self) -> None:
        import pyvisa

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
        """Return the next bytes: at most `size` bytes, or the bytes up to and including `end`.

        Raises InstrumentTimeout if the bytes do not arrive within `timeout_s` (s).
        """
        with self._errors_named(timeout_s):
            self._resource.timeout = max(round(timeout_s * 1000), 1)
            self._resource.read_termination = end.decode("ascii") or None
            return bytes(self._resource.read_bytes(size, break_on_termchar=bool(end)))

    def close(self) -> None:
        """Close the resource; closing twice is allowed."""
        with self._errors_named():
            self._resource.close()


def _send_at_once(resource: Any) -> None:
    """Make the TCP socket of a resource of pyvisa-py send every message at once (TCP_NODELAY)."""
    # Without the option the operating system waits 40 ms and more for the acknowledgement of the message before.
    # pyvisa-py ignores VI_ATTR_TCPIP_NODELAY.
    with suppress(AttributeError, KeyError, OSError):
        interface = resource.visalib.sessions[resource.session].interface
        interface.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)


def _wait_by_the_monotonic_clock() -> None:
    """Make pyvisa-py measure its timeouts with the monotonic clock."""
    from pyvisa_py import sessions, tcpip
    from pyvisa_py.protocols import rpc

    for module in (sessions, tcpip, rpc):
        module.time = SimpleNamespace(time=time.monotonic, sleep=time.sleep)
