"""Emulate a protection that has a level and a switch."""

from __future__ import annotations

import math
from typing import Literal

from eimi_drivers.emulators.supply import CoilSupply


class TripLevel:
    """Switch the emulated output off when its voltage or its current exceeds a level.

    Parameters
    ----------
    supply : CoilSupply
        The emulated supply.
    quantity : "voltage_V" or "current_A"
        The quantity that is compared with the level.
    level : float
        The level after power-up.
    highest : float
        The highest level that the supply accepts.
    on : bool
        True if the protection is on after power-up.
    """

    def __init__(
        self,
        supply: CoilSupply,
        quantity: Literal["voltage_V", "current_A"],
        level: float,
        highest: float = math.inf,
        on: bool = True,
    ) -> None:
        self.level, self.on = level, on
        self._supply, self._quantity, self._highest = supply, quantity, highest
        self.apply(level, on)

    def apply(self, level: float, on: bool) -> bool:
        """Set level and switch; return False if the level is out of range or the supply is locked."""
        if not 0 < level <= self._highest:
            return False
        taken = self._supply.set_trip_levels(**{self._quantity: level if on else math.inf})
        if taken:
            self.level, self.on = level, on
        return taken

    def set_level(self, level: float) -> bool:
        """Set a new level and keep the position of the switch."""
        return self.apply(level, self.on)

    def switch(self, on: bool) -> bool:
        """Switch the protection on or off."""
        return self.apply(self.level, on)
