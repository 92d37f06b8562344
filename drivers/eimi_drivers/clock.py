"""Time on a bench and time on the virtual rig."""

from __future__ import annotations

import time


class WallClock:
    """Real seconds, from the monotonic clock of the operating system."""

    def now(self) -> float:
        """Seconds since an arbitrary zero."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait."""
        if seconds > 0:
            time.sleep(seconds)


class SimulatedClock:
    """Seconds that pass only when somebody sleeps, so that a simulated hour costs nothing."""

    def __init__(self, start_s: float = 0.0) -> None:
        self._now = start_s

    def now(self) -> float:
        """Simulated seconds."""
        return self._now

    def sleep(self, seconds: float) -> None:
        """Advance the time at once."""
        self._now += max(seconds, 0.0)
