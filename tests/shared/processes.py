"""Wait for processes that a test has started, and for their effects."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

WAIT_AT_MOST_S = 600.0


def wait_until(true: Callable[[], bool], otherwise: str) -> None:
    """Wait until `true()` is True; raise RuntimeError with the text `otherwise` after 600 s."""
    until = time.monotonic() + WAIT_AT_MOST_S
    while not true():
        if time.monotonic() > until:
            raise RuntimeError(otherwise)
        time.sleep(0.005)


def alive(process: int) -> bool:
    """Return whether the process with this number exists and has not ended."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False
