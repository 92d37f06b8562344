"""Serve an emulated supply over HiSLIP (IVI-6.1, a protocol for instruments on a network)."""

from __future__ import annotations

import socketserver
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from eimi_drivers.supplies.transport import Responder

HEADER = struct.Struct("!2sBBIQ")  # "HS", type, control code, parameter, length of the payload (IVI-6.1, 2.4)
INITIALIZE, DATA, DATA_END, ASYNC_MESSAGE_SIZE, ASYNC_INITIALIZE = 0, 6, 7, 15, 17  # types (IVI-6.1, table 4)
ANSWER_TO = {INITIALIZE: 1, ASYNC_INITIALIZE: 18, ASYNC_MESSAGE_SIZE: 16}
VERSION_1_0 = 0x0100
LARGEST_MESSAGE = 1 << 20


@contextmanager
def serve_hislip(instrument: Responder) -> Iterator[str]:
    """Serve an emulated instrument over HiSLIP while the `with` block runs, and yield the VISA address."""
    lock = threading.Lock()

    class Connection(socketserver.StreamRequestHandler):
        def handle(self) -> None:
            with suppress(OSError):
                while len(header := self.rfile.read(HEADER.size)) == HEADER.size:
                    _, kind, _, parameter, length = HEADER.unpack(header)
                    payload = self.rfile.read(length)
                    if kind in ANSWER_TO:
                        answer = struct.pack("!Q", LARGEST_MESSAGE) if kind == ASYNC_MESSAGE_SIZE else b""
                        session = VERSION_1_0 << 16 | 1 if kind == INITIALIZE else 0
                        self._send(ANSWER_TO[kind], session, answer)
                    elif kind in {DATA, DATA_END}:
                        with lock:
                            reply = instrument.receive(payload)
                        if reply:
                            self._send(DATA_END, parameter, reply)

        def _send(self, kind: int, parameter: int, payload: bytes) -> None:
            self.wfile.write(HEADER.pack(b"HS", kind, 0, parameter, len(payload)) + payload)

    class Server(socketserver.ThreadingTCPServer):
        daemon_threads = True
        block_on_close = False

    with Server(("127.0.0.1", 0), Connection) as server:
        threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
        try:
            yield f"TCPIP::127.0.0.1::hislip0,{server.server_address[1]}::INSTR"
        finally:
            server.shutdown()
