"""Measure time on a bench (real seconds) and on the virtual rig (simulated seconds)."""

from __future__ import annotations

import time


class WallClock:
    """Clock of a bench, which follows the monotonic clock of the operating system."""

    def now(self) -> float:
        """Return the time since an arbitrary zero, s."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait for `seconds` (s) of real time; return at once if `seconds` is not positive."""
        if seconds > 0:
            time.sleep(seconds)


class SimulatedClock:
    """Clock of the virtual rig, whose time advances only by calls of `sleep`, without any real wait."""

    def __init__(self, start_s: float = 0.0) -> None:
        self._now = start_s

    def now(self) -> float:
        """Return the simulated time, s."""
        return self._now

    def sleep(self, seconds: float) -> None:
        """Advance the simulated time by `seconds` (s) without waiting."""
        self._now += max(seconds, 0.0)
