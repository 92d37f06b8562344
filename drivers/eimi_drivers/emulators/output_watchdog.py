"""Emulate a timer that switches the output off."""

from __future__ import annotations

from eimi_drivers.emulators.supply import CoilSupply


class OutputWatchdog:
    """Trip the emulated supply if its output is on when a time has passed since the last restart.

    Parameters
    ----------
    supply : CoilSupply
        The emulated supply.
    seconds : float
        The time that is valid after power-up, s; `set_seconds` changes it.

    Attributes
    ----------
    on : bool
        True if the timer is running.
    expired : bool
        True after the timer has switched the output off.
    """

    def __init__(self, supply: CoilSupply, seconds: float) -> None:
        self.seconds = seconds
        self.on = self.expired = False
        self._supply = supply
        self._restarted_s = supply.clock.now()

    def restart(self) -> None:
        """Count the time from now."""
        self._restarted_s = self._supply.clock.now()

    def switch(self, on: bool) -> bool:
        """Start or stop the timer."""
        self.on, self.expired = on, False
        return True

    def set_seconds(self, seconds: float, least: float, most: float) -> bool:
        """Set the time (s) and return True; if it is out of range, change nothing and return False."""
        if not least <= seconds <= most:
            return False
        self.seconds = seconds
        return True

    def watch(self) -> bool:
        """Switch the output off if the time has passed; return whether this call switched it off."""
        age_s = self._supply.clock.now() - self._restarted_s
        if not self.on or age_s <= self.seconds or not self._supply.output_on():
            return False
        self._supply.trip()
        self.expired = True
        return True
