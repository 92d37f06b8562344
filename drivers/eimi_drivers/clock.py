"""Measure time in real seconds for real instruments, and in simulated seconds for the virtual rig.

The virtual rig is a simulated supply, coil, beam and camera.
"""

from __future__ import annotations

import time


class WallClock:
    """Clock of real instruments, which follows the monotonic clock of the operating system."""

    def now(self) -> float:
        """Return the time since an arbitrary zero, s."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait for `seconds` (s) of real time; return at once if `seconds` is not positive."""
        if seconds > 0:
            time.sleep(seconds)


class SimulatedClock:
    """Clock of simulated instruments, whose time advances only by calls of `sleep`, without any real wait.

    Parameters
    ----------
    start_s : float
        The simulated time at the start, s.
    """

    def __init__(self, start_s: float = 0.0) -> None:
        self._now = start_s

    def now(self) -> float:
        """Return the simulated time, s."""
        return self._now

    def sleep(self, seconds: float) -> None:
        """Advance the simulated time by `seconds` (s) without waiting; a negative value leaves the time unchanged."""
        self._now += max(seconds, 0.0)
