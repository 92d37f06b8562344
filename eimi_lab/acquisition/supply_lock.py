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
from eimi_lab.process.writer_lock import WriterLock, is_being_written


@contextmanager
def only_run_on(address: str) -> Iterator[None]:
    """Exclude other runs of the same user on this computer from the supply at an address, until the context ends.

    All outputs (channels) of one supply share one lock.

    Raises
    ------
    InstrumentError
        If another run uses the supply.
    InputError
        If the file of the lock cannot be created.
    """
    place = serial_port(address)
    line = os.path.realpath(place) if place.startswith("/") else place.upper()
    of_session = os.environ.get("XDG_RUNTIME_DIR", "")
    folder = Path(of_session if os.access(of_session, os.W_OK) else tempfile.gettempdir())
    user = os.getuid() if hasattr(os, "getuid") else 0
    path = folder / f"eimi-supply-{user}-{hashlib.sha256(line.encode()).hexdigest()[:16]}"
    try:
        lock = WriterLock(path)
    except InputError as error:
        if not is_being_written(path):
            raise
        raise InstrumentError(f"{address}: another run uses this supply; wait until it has ended") from error
    try:
        yield
    finally:
        lock.release()
