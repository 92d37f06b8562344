"""Allow only one run at a time for each supply.

The operating system lets only one run open a serial port. A supply in a network accepts several connections, so that
two runs could change the current of the same supply in turn.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from eimi_drivers.interfaces import InstrumentError
from eimi_drivers.supplies.address import serial_port
from eimi_lab.process.errors import InputError
from eimi_lab.process.writer_lock import WriterLock


@contextmanager
def only_run_on(address: str) -> Iterator[None]:
    """Exclude other runs from the supply at an address until the context ends.

    The operating system releases the lock if the process dies. All outputs (channels) of one supply share one lock. The
    lock excludes only runs of the same user on the same computer.

    Raises
    ------
    InstrumentError
        If another run uses the supply.
    """
    place = serial_port(address)
    line = os.path.realpath(place) if place.startswith("/") else place.upper()
    folder = Path(os.environ.get("XDG_RUNTIME_DIR") or tempfile.gettempdir())
    user = os.getuid() if hasattr(os, "getuid") else 0
    try:
        lock = WriterLock(folder / f"eimi-supply-{user}-{hashlib.sha256(line.encode()).hexdigest()[:16]}")
    except InputError as error:
        raise InstrumentError(f"{address}: another run uses this supply; wait until it has ended") from error
    try:
        yield
    finally:
        lock.release()
