"""Emulate a protection of a supply that has a threshold (the trip level) and an on-off switch."""

from __future__ import annotations

import math
from typing import Literal

from eimi_drivers.emulators.supply import CoilSupply


class TripLevel:
    """Protection that switches the output of an emulated supply off at a voltage or current above its trip level.

    Parameters
    ----------
    supply : CoilSupply
        The model of the supply and its coil.
    quantity : "voltage_V" or "current_A"
        The quantity that is compared with the trip level.
    level : float
        The trip level (threshold) after power-up, V or A.
    highest : float
        The highest trip level that the supply accepts, V or A.
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
        """Set the trip level (V or A) and the switch of the protection, and return whether the supply accepted both."""
        if not 0 < level <= self._highest:
            return False
        accepted = self._supply.set_trip_levels(**{self._quantity: level if on else math.inf})
        if accepted:
            self.level, self.on = level, on
        return accepted

    def set_level(self, level: float) -> bool:
        """Set the trip level (V or A), and return whether the supply accepted it."""
        return self.apply(level, self.on)

    def switch(self, on: bool) -> bool:
        """Switch the protection on or off, and return whether the supply obeyed."""
        return self.apply(self.level, on)
