"""Processes that a test started: whether they live, and waiting for what they do."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

WAIT_AT_MOST_S = 600.0


def wait_until(true: Callable[[], bool], otherwise: str) -> None:
    """Wait; raises RuntimeError where it never comes true."""
    until = time.monotonic() + WAIT_AT_MOST_S
    while not true():
        if time.monotonic() > until:
            raise RuntimeError(otherwise)
        time.sleep(0.005)


def alive(process: int) -> bool:
    """Whether a process is there, and is more than the entry of one that has ended."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False
