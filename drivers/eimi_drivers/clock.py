"""Clocks of drivers: real seconds for real instruments, simulated seconds for simulated instruments."""

from __future__ import annotations

import time


class WallClock:
    """Clock of real seconds, which uses the monotonic clock of the operating system."""

    def now(self) -> float:
        """Return the time since an arbitrary zero, s."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait for `seconds` (s) of real time; return at once if `seconds` is not positive."""
        if seconds > 0:
            time.sleep(seconds)


class SimulatedClock:
    """Clock of simulated seconds; the time advances only when `sleep` is called.

    Parameters
    ----------
    start_s : float
        Simulated time at the start, s.
    """

    def __init__(self, start_s: float = 0.0) -> None:
        self._now = start_s

    def now(self) -> float:
        """Return the simulated time, s."""
        return self._now

    def sleep(self, seconds: float) -> None:
        """Advance the simulated time by `seconds` (s) without waiting; a negative value changes nothing."""
        self._now += max(seconds, 0.0)
