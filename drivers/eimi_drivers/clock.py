"""Measure time on a bench (real seconds) and on the virtual rig (simulated seconds)."""

from __future__ import annotations

import time


class WallClock:
    """Count real seconds with the monotonic clock of the operating system."""

    def now(self) -> float:
        """Return the seconds since an arbitrary zero."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait for this number of real seconds; return at once if it is not positive."""
        if seconds > 0:
            time.sleep(seconds)


class SimulatedClock:
    """Count simulated seconds, which pass only during `sleep`; a simulated hour takes no real time."""

    def __init__(self, start_s: float = 0.0) -> None:
        self._now = start_s

    def now(self) -> float:
        """Return the simulated seconds since the start."""
        return self._now

    def sleep(self, seconds: float) -> None:
        """Advance the simulated time without waiting."""
        self._now += max(seconds, 0.0)
