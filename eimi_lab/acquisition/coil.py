"""The supply as a coil wants it: current moves in ramps, and is what was asked for."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable

from eimi_drivers.interfaces import Clock, InstrumentError, PowerSupply
from eimi_lab.config.protocol import Ramp

REACHED_WITHIN_S = 3.0  # supplies measure a few times a second, and coils are slow
POLL_S = 0.1
TALK_EVERY_S, TALK_AT_ZERO_EVERY_S = 2.0, 8.0
"""A supply is asked for faults so often, whatever the run waits for: a watchdog of its own hears from it, too."""


def without_contact(supply: object) -> str:
    """What becomes of the coil when the cable is pulled or the computer dies, as the driver has it."""
    return str(getattr(supply, "without_contact", "not known of this driver"))


def never() -> None:
    """For a ramp that nothing may stop."""


class Coil:
    """A coil on a supply, set to `asked_A` since `changed_s` on the clock.

    `stop_if_asked` is called between operations, never within one, and may raise.
    """

    def __init__(self, supply: PowerSupply, clock: Clock, rule: Ramp, asked_A: float = 0.0) -> None:
        self.supply = supply
        self._clock = clock
        self._rule = rule
        self.asked_A = asked_A
        self.changed_s = self._asked_s = clock.now()
        self._stepping = threading.Lock()

    def keep_in_touch(self) -> None:
        """Ask the supply for faults when it was not asked for a while. Raises what `PowerSupply.check` raises.

        Not while another thread sets a current: two exchanges at once would mix.
        """
        every_s = TALK_EVERY_S if self.asked_A else TALK_AT_ZERO_EVERY_S
        if self._clock.now() - self._asked_s > every_s and self._stepping.acquire(blocking=False):
            try:
                self._asked_s = self._clock.now()
                self.supply.check()
            finally:
                self._stepping.release()

    def ramp_to(self, current_A: float, stop_if_asked: Callable[[], None] = never) -> None:
        """Ramp to a current. Raises what `PowerSupply.set_current` raises."""
        start = self.asked_A
        steps = math.ceil(round(abs(current_A - start) / self._rule.step_A, 6))
        pause = self._rule.step_A / self._rule.rate_A_per_s
        for step in range(1, steps + 1):
            stop_if_asked()
            began = self._clock.now()
            self.asked_A = current_A if step == steps else round(start + (current_A - start) * step / steps, 6)
            self.supply.set_current(self.asked_A)
            self.changed_s = self._clock.now()
            self._pause(pause - (self._clock.now() - began), stop_if_asked)

    def ramp_down(self, stop_if_asked: Callable[[], None] = never) -> None:
        """Ramp to zero within `ramp.down_within_s`, in larger steps where the supply is too slow for the rule's.

        Raises what `PowerSupply.set_current` raises.
        """
        start = self.asked_A
        seconds = min(abs(start) / self._rule.rate_A_per_s, self._rule.down_within_s)
        pause = seconds / max(1, math.ceil(round(abs(start) / self._rule.step_A, 6)))
        began = self._clock.now()
        while self.asked_A and (elapsed := self._clock.now() - began) < seconds:
            stop_if_asked()
            self.asked_A = round(start * max(0.0, 1 - (elapsed + pause) / seconds), 6)
            self.supply.set_current(self.asked_A)
            self.changed_s = self._clock.now()
            self._pause(began + elapsed + pause - self._clock.now(), stop_if_asked)

    def _pause(self, seconds: float, stop_if_asked: Callable[[], None]) -> None:
        until = self._clock.now() + seconds
        while (left := until - self._clock.now()) > POLL_S:
            self._clock.sleep(POLL_S)
            stop_if_asked()
        self._clock.sleep(max(0.0, left))

    def step_to(self, current_A: float) -> None:
        """Set a current at once, without a ramp; in another thread, perhaps. Raises as `PowerSupply.set_current`."""
        with self._stepping:
            self.asked_A = current_A
            self.supply.set_current(current_A)
            self.changed_s = self._asked_s = self._clock.now()

    def wait_until_reached(self, stop_if_asked: Callable[[], None] = never) -> None:
        """Wait until the measured current is the one asked for. Raises InstrumentError when it stays away."""
        began = self._clock.now()
        while abs((measured := self.supply.measure().current_A) - self.asked_A) > self._rule.tolerance_A:
            stop_if_asked()
            self.supply.check()
            if self._clock.now() - began > REACHED_WITHIN_S:
                raise self._off_target(measured)
            self._clock.sleep(POLL_S)

    def measured_A(self) -> float:
        """The measured current. Raises InstrumentError when it is not the one asked for."""
        measured = self.supply.measure().current_A
        if abs(measured - self.asked_A) > self._rule.tolerance_A:
            raise self._off_target(measured)
        return measured

    def _off_target(self, measured: float) -> InstrumentError:
        return InstrumentError(
            f"{self.supply.identify().address}: {measured:.3f} A measured at a set-point of {self.asked_A:g} A, "
            f"further off than ramp.tolerance_A = {self._rule.tolerance_A:g}; is the coil connected, the voltage "
            "limit high enough?"
        )
