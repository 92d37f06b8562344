"""Emulate a timer inside a supply that switches the output off."""

from __future__ import annotations

from eimi_drivers.emulators.supply import CoilSupply


class OutputWatchdog:
    """Timer that switches the output of an emulated supply off unless the timer is restarted in time.

    Parameters
    ----------
    supply : CoilSupply
        The model of the supply and its coil.
    seconds : float
        The duration of the timer after power-up, s.

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
        """Restart the timer."""
        self._restarted_s = self._supply.clock.now()

    def switch(self, on: bool) -> bool:
        """Start the timer if `on` is true, otherwise stop it. Return True, because this cannot fail."""
        self.on, self.expired = on, False
        return True

    def set_seconds(self, seconds: float, least: float, most: float) -> bool:
        """Set the duration (s) of the timer if it is between `least` and `most`, and return whether it was set."""
        if not least <= seconds <= most:
            return False
        self.seconds = seconds
        return True

    def watch(self) -> bool:
        """Switch the output off if the timer has expired, and return whether this call switched the output off."""
        age_s = self._supply.clock.now() - self._restarted_s
        if not self.on or age_s <= self.seconds or not self._supply.output_on():
            return False
        self._supply.trip()
        self.expired = True
        return True
