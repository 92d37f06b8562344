"""A line on which an emulated coil tells its true current, for a virtual beam that hangs in it.

It is apart from the supply's own line, which has one user at a time and shows what meters show. Every newline that
comes is answered with the current in amperes and a newline.
"""

from __future__ import annotations

import re
import socket
from contextlib import AbstractContextManager

from eimi_drivers.emulators.serve import serve_tcp
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import InstrumentDisconnected, InstrumentError, InstrumentTimeout, ReplyNotUnderstood

ANSWER_WITHIN_S = 30.0  # a process that emulates a coil may get little of a busy machine
ADDRESS = re.compile(r"TCPIP::(?P<host>[^:]+)::(?P<port>\d+)::SOCKET")
"""Where an emulated coil is found, as `eimi emulate` tells it."""


class _TellsCurrent:
    def __init__(self, coil: CoilSupply) -> None:
        self._coil = coil

    def receive(self, data: bytes) -> bytes:
        return b"%.9f\n" % self._coil.coil_current_A() * data.count(b"\n")


def serve_coil(coil: CoilSupply) -> AbstractContextManager[str]:
    """Tell the coil's current on a free TCP port while the context lasts; its value is the address, as `ADDRESS`."""
    return serve_tcp(_TellsCurrent(coil))


class RemoteCoil:
    """An emulated coil in another process."""

    def __init__(self, address: str) -> None:
        """Raises InstrumentError for an address of another form, InstrumentDisconnected where nothing answers."""
        found = ADDRESS.fullmatch(address)
        if found is None:
            raise InstrumentError(f"{address}: should be TCPIP::HOST::PORT::SOCKET, as `eimi emulate` tells it")
        self._address = address
        try:
            self._line = socket.create_connection((found["host"], int(found["port"])), ANSWER_WITHIN_S)
        except (OSError, OverflowError) as error:
            raise InstrumentDisconnected(f"{address}: no emulated coil answers ({error})") from error

    def coil_current_A(self) -> float:
        """The true current, A. Raises InstrumentDisconnected, InstrumentTimeout, ReplyNotUnderstood."""
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
        """Hang up."""
        self._line.close()
