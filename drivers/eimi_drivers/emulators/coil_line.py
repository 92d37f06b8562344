"""Send the true current of an emulated coil to a program that simulates the beam.

The answer to every received newline is the current in amperes and a newline.
"""

from __future__ import annotations

import re
import socket
from contextlib import AbstractContextManager

from eimi_drivers.emulators.serve import serve_tcp
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import InstrumentDisconnected, InstrumentError, InstrumentTimeout, ReplyNotUnderstood

ANSWER_WITHIN_S = 30.0
"""Time limit (s) of an answer. The limit is long because other programs may delay the process with the coil."""

ADDRESS = re.compile(r"TCPIP::(?P<host>[^:]+)::(?P<port>\d+)::SOCKET")
"""The form of the address of an emulated coil that `eimi emulate` prints."""


class _CurrentResponder:
    def __init__(self, coil: CoilSupply) -> None:
        self._coil = coil

    def receive(self, data: bytes) -> bytes:
        return b"%.9f\n" % self._coil.coil_current_A() * data.count(b"\n")


def serve_coil(coil: CoilSupply, port: int = 0) -> AbstractContextManager[str]:
    """Serve the true current of a coil on a TCP port while the `with` block runs, and yield the address.

    The address is a text such as ``TCPIP::127.0.0.1::5555::SOCKET``. If `port` is 0, a free port is used.
    """
    return serve_tcp(_CurrentResponder(coil), port=port)


class RemoteCoil:
    """Connection to an emulated coil in another process, from which the true current is read.

    Parameters
    ----------
    address : str
        The address of the coil that `eimi emulate` prints, such as ``TCPIP::127.0.0.1::5555::SOCKET``.

    Raises
    ------
    InstrumentError
        The address has another form.
    InstrumentDisconnected
        No program accepts the connection.
    InstrumentTimeout
        No answer arrived within `ANSWER_WITHIN_S` (s).
    ReplyNotUnderstood
        The first answer is not a current.
    """

    def __init__(self, address: str) -> None:
        match = ADDRESS.fullmatch(address)
        if match is None:
            raise InstrumentError(
                f"{address}: the address of an emulated coil should be TCPIP::HOST::PORT::SOCKET, as `eimi emulate` "
                "prints it"
            )
        self._address = address
        try:
            self._line = socket.create_connection((match["host"], int(match["port"])), ANSWER_WITHIN_S)
        except (OSError, OverflowError) as error:
            raise InstrumentDisconnected(f"{address}: no emulated coil answers ({error})") from error
        try:
            self.coil_current_A()
        except (InstrumentTimeout, ReplyNotUnderstood) as error:
            self.close()
            raise type(error)(
                f"{error}. An emulated supply and its coil have two addresses; "
                "`eimi emulate` prints the address of the coil in a line that begins with #"
            ) from error
        except InstrumentDisconnected:
            self.close()
            raise

    def coil_current_A(self) -> float:
        """Return the true current in the coil, A.

        Raises
        ------
        InstrumentDisconnected
            The process of the coil has ended.
        InstrumentTimeout
            No answer arrived within `ANSWER_WITHIN_S` (s).
        ReplyNotUnderstood
            The answer is not a number.
        """
        answer = b""
        try:
            self._line.sendall(b"\n")
            while not answer.endswith(b"\n"):
                if not (more := self._line.recv(64)):
                    raise InstrumentDisconnected(f"{self._address}: the program with the emulated coil has ended")
                answer += more
            return float(answer)
        except TimeoutError as error:
            raise InstrumentTimeout(
                f"{self._address}: no answer of the emulated coil within {ANSWER_WITHIN_S:g} s"
            ) from error
        except OSError as error:
            raise InstrumentDisconnected(
                f"{self._address}: the program with the emulated coil has ended ({error})"
            ) from error
        except ValueError as error:
            raise ReplyNotUnderstood(
                f"{self._address}: the answer of the emulated coil must be a current in A, but it is {answer!r}"
            ) from error

    def close(self) -> None:
        """Close the connection to the emulated coil."""
        self._line.close()
