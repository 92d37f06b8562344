"""Serve an emulated instrument on a serial port that can be unplugged and plugged in again."""

from __future__ import annotations

import os
import select
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from eimi_drivers.emulators.faults import FaultyInstrument
from eimi_drivers.emulators.serve import open_terminal

PLUGGED_IN_AFTER_S = 0.3
"""Time (s) from a cut of the line until the port exists again."""


@contextmanager
def serve_port(line: FaultyInstrument, name: str = "ttyEMULATED0") -> Iterator[str]:
    """Serve an emulated instrument on a serial port while the `with` block runs, and yield the path of the port.

    If a fault cuts the line (the connection), the port disappears. Unless the line is cut permanently, the port exists
    again after `PLUGGED_IN_AFTER_S` (s).

    Parameters
    ----------
    line : FaultyInstrument
        The emulated instrument with its line.
    name : str
        The name of the port in its folder.

    Raises
    ------
    InstrumentError
        The operating system has no pseudo-terminals.
    """
    wake_read, wake_write = os.pipe()
    with tempfile.TemporaryDirectory(prefix="eimi-port-") as folder:
        port = Path(folder) / name
        *ends, path = open_terminal()
        port.symlink_to(path)
        thread = threading.Thread(target=_serve_until_stopped, args=(line, port, ends, wake_read), daemon=True)
        thread.start()
        try:
            yield str(port)
        finally:
            os.close(wake_write)
            thread.join()
            os.close(wake_read)


def _serve_until_stopped(line: FaultyInstrument, port: Path, ends: list[int], wake_read: int) -> None:
    while True:
        device_end, driver_end = ends
        stopped = False
        with suppress(OSError):  # a fault or the other side cut the line
            while not (stopped := wake_read in (ready := select.select([device_end, wake_read], [], [])[0])):
                if ready:
                    os.write(device_end, line.receive(os.read(device_end, 4096)))
        port.unlink(missing_ok=True)
        os.close(driver_end)
        os.close(device_end)
        if stopped or line.lost or select.select([wake_read], [], [], PLUGGED_IN_AFTER_S)[0]:
            return
        *ends, path = open_terminal()
        port.symlink_to(path)
