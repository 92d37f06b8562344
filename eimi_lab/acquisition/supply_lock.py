"""Allow only one run at a time for each supply."""

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
    """Exclude other runs of the same user on this computer from the supply at an address, until the context ends.

    All outputs (channels) of one supply share one lock.

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
