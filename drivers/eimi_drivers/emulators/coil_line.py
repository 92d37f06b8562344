"""Send the true current of an emulated coil to a virtual beam in another process.

This line is separate from the supply's own line, which has one user at a time and gives the readings of the meters.
Every received newline is answered with the current in amperes and a newline.
"""

from __future__ import annotations

import re
import socket
from contextlib import AbstractContextManager

from eimi_drivers.emulators.serve import serve_tcp
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import InstrumentDisconnected, InstrumentError, InstrumentTimeout, ReplyNotUnderstood

ANSWER_WITHIN_S = 30.0
"""Time limit (s) of an answer; on a busy machine the process with the coil may get little processor time."""

ADDRESS = re.compile(r"TCPIP::(?P<host>[^:]+)::(?P<port>\d+)::SOCKET")
"""The form of the address that `eimi emulate` prints."""


class _CurrentResponder:
    def __init__(self, coil: CoilSupply) -> None:
        self._coil = coil

    def receive(self, data: bytes) -> bytes:
        return b"%.9f\n" % self._coil.coil_current_A() * data.count(b"\n")


def serve_coil(coil: CoilSupply, port: int = 0) -> AbstractContextManager[str]:
    """Serve the coil's current on a TCP port while the context lasts; its value is the address, see `ADDRESS`.

    Port 0 selects a free one.
    """
    return serve_tcp(_CurrentResponder(coil), port=port)


class RemoteCoil:
    """Read the current of an emulated coil in another process.

    Parameters
    ----------
    address : str
        The address that `eimi emulate` prints, see `ADDRESS`.

    Raises
    ------
    InstrumentError
        The address has another form.
    InstrumentDisconnected
        No emulated coil answers at the address.
    """

    def __init__(self, address: str) -> None:
        match = ADDRESS.fullmatch(address)
        if match is None:
            raise InstrumentError(f"{address}: should be TCPIP::HOST::PORT::SOCKET, as `eimi emulate` prints it")
        self._address = address
        try:
            self._line = socket.create_connection((match["host"], int(match["port"])), ANSWER_WITHIN_S)
        except (OSError, OverflowError) as error:
            raise InstrumentDisconnected(f"{address}: no emulated coil answers ({error})") from error

    def coil_current_A(self) -> float:
        """Return the true current, A. Raises InstrumentDisconnected, InstrumentTimeout, ReplyNotUnderstood."""
        answer = b""
        try:
            self._line.sendall(b"\n")
            while not answer.endswith(b"\n"):
                if not (more := self._line.recv(64)):
                    raise InstrumentDisconnected(f"{self._address}: the emulated coil is gone")
                answer += more
            return float(answer)
        except TimeoutError as error:
            raise InstrumentTimeout(f"{self._address}: no answer of the coil within {ANSWER_WITHIN_S:g} s") from error
        except OSError as error:
            raise InstrumentDisconnected(f"{self._address}: the emulated coil is gone ({error})") from error
        except ValueError as error:
            raise ReplyNotUnderstood(f"{self._address}: the coil answers {answer!r}") from error

    def close(self) -> None:
        """Close the connection."""
        self._line.close()
