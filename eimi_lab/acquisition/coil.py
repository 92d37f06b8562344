"""The supply as a coil wants it: current moves in ramps, and is what was asked for."""

from __future__ import annotations

import math
from collections.abc import Callable

from eimi_drivers.interfaces import Clock, InstrumentError, PowerSupply
from eimi_lab.config.protocol import Ramp

REACHED_WITHIN_S = 3.0  # supplies measure a few times a second, and coils are slow
POLL_S = 0.1


def never() -> None:
    """For a ramp that nothing may stop."""


class Coil:
    """A coil on a supply, set to `asked_A`.

    `stop_if_asked` is called between operations, never within one, and may raise.
    """

    def __init__(self, supply: PowerSupply, clock: Clock, rule: Ramp, asked_A: float = 0.0) -> None:
        self.supply = supply
        self._clock = clock
        self._rule = rule
        self._asked_A = asked_A

    def ramp_to(self, current_A: float, stop_if_asked: Callable[[], None] = never) -> None:
        """Ramp to a current. Raises what `PowerSupply.set_current` raises."""
        start = self._asked_A
        steps = math.ceil(round(abs(current_A - start) / self._rule.step_A, 6))
        pause = self._rule.step_A / self._rule.rate_A_per_s
        for step in range(1, steps + 1):
            stop_if_asked()
            began = self._clock.now()
            self._asked_A = current_A if step == steps else round(start + (current_A - start) * step / steps, 6)
            self.supply.set_current(self._asked_A)
            self._clock.sleep(max(0.0, pause - (self._clock.now() - began)))

    def wait_until_reached(self, stop_if_asked: Callable[[], None] = never) -> None:
        """Wait until the measured current is the one asked for. Raises InstrumentError when it stays away."""
        began = self._clock.now()
        while abs((measured := self.supply.measure().current_A) - self._asked_A) > self._rule.tolerance_A:
            stop_if_asked()
            self.supply.check()
            if self._clock.now() - began > REACHED_WITHIN_S:
                raise self._off_target(measured)
            self._clock.sleep(POLL_S)

    def measured_A(self) -> float:
        """The measured current. Raises InstrumentError when it is not the one asked for."""
        measured = self.supply.measure().current_A
        if abs(measured - self._asked_A) > self._rule.tolerance_A:
            raise self._off_target(measured)
        return measured

    def _off_target(self, measured: float) -> InstrumentError:
        return InstrumentError(
            f"{self.supply.identify().address}: {measured:.3f} A measured at a set-point of {self._asked_A:g} A, "
            f"further off than ramp.tolerance_A = {self._rule.tolerance_A:g}; is the coil connected, the voltage "
            "limit high enough?"
        )
