"""Change the current of a coil in ramps, and compare the measured current with the set-point."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace

from eimi_drivers.interfaces import (
    Clock,
    InstrumentDisconnected,
    InstrumentError,
    InstrumentTimeout,
    Off,
    PowerSupply,
    Reading,
    ReplyNotUnderstood,
)
from eimi_drivers.supplies.off import off_limit_A, switch_off
from eimi_lab.acquisition.interlocks import BeyondInterlock, Interlocks, readings_of
from eimi_lab.config.protocol import Ramp
from eimi_lab.dataset.steps import SetPoint

REACHED_WITHIN_S = 3.0
"""Longest time (s) within which the measured current must reach its set-point. Supplies measure a few times a second.
"""

POLL_S = 0.1
HEED_EVERY_S = 0.02
"""Longest time (s) of a pause between two steps of a ramp, or between two measurements, without a look for signals."""

SIMULATED_CHECK_EVERY_S, SIMULATED_CHECK_AT_ZERO_EVERY_S = 2.0, 8.0
"""Intervals (s) between two checks of a simulated supply for faults: at a set-point other than zero, and at zero."""

WATCH_EVERY_S = 1.5
"""Interval (s) at which `watch` measures the current and checks the supply for faults, in every part of a run."""

FOLLOWS_WITHIN_S = 1.5
"""Largest assumed lag (s) of the measured current behind the set-points of a ramp."""

EXCHANGES_REMEMBERED = 3
"""Number of recent exchanges with the supply. The longest of their durations is the expected duration of a step of the
ramp down."""

MEASURED_AGAIN_AFTER_S = 0.2
"""Time (s) after which a wrong current is measured again. Only a second wrong value ends the run."""


def without_contact(supply: object) -> str:
    """Return what the output of the supply does if the cable is pulled or the computer fails, as its driver says."""
    return str(
        getattr(
            supply,
            "without_contact",
            "nobody knows what the output does, because the driver of the supply does not report it",
        )
    )


def no_sensors() -> dict[str, float]:
    """Return an empty dictionary: the readings of a bench without sensors."""
    return {}


def never() -> None:
    """Do nothing. A ramp that must not be interrupted takes this function as `stop_if_asked`."""


class Coil:
    """A coil on a power supply, with the set-point of the supply and the checks of the current."""

    # supply : PowerSupply
    #     The supply, with its limits.
    # clock : Clock
    #     Clock of the ramps and waits.
    # rule : Ramp
    #     Rate, step and tolerance of the current.
    # asked_A : float
    #     Present set-point of the supply, A.
    # simulated : bool
    #     Whether the supply is simulated. Its current is measured only if there are interlocks.
    # interlocks : Interlocks
    #     Bounds of the readings; a reading outside its bounds ends the run.
    # sense : callable
    #     Reads the sensors and returns their values by name.
    # changed_s : float
    #     Time at which the set-point last changed, s on the clock.
    # leads_swapped : bool
    #     Whether the leads of the coil are swapped. Its current is then minus the current of the supply.
    # out_of_control : bool
    #     Whether a current or a reading was wrong, or the run was blocked. The coil is then switched off without
    #     a ramp.
    # unreachable : str
    #     Why the supply gives no usable answer, in words; empty if it answers.

    def __init__(
        self,
        supply: PowerSupply,
        clock: Clock,
        rule: Ramp,
        asked_A: float = 0.0,
        simulated: bool = False,
        interlocks: Interlocks | None = None,
        sense: Callable[[], Mapping[str, float]] = no_sensors,
    ) -> None:
        self.supply = supply
        self.simulated = simulated
        self._interlocks = interlocks or Interlocks()
        self._sense = sense
        self._clock = clock
        self._rule = rule
        self.asked_A = asked_A
        self.changed_s = self._watched_s = clock.now()
        self.leads_swapped = self.out_of_control = False
        self.unreachable = ""
        self._recent: deque[tuple[float, float]] = deque([(self.changed_s, asked_A)])
        self._ends_since_s: float | None = None
        self._took_s = deque([0.0], maxlen=EXCHANGES_REMEMBERED)
        self._stepping = threading.Lock()
        self._set_points: list[SetPoint] = []

    def switch_off(self) -> Off | None:
        """Switch the supply off, and return the current measured afterwards; None if the supply cannot measure.

        Raises SwitchOffFailed if the supply could not be confirmed off.
        """
        was_A, self.asked_A, sent_s = self.asked_A, 0.0, self._clock.now()
        self._recent.append((sent_s, 0.0))
        self._interlocks.restart()
        off = switch_off(self.supply, self._clock)
        if was_A:
            self._note_set_point(sent_s, self._clock.now())
        return off

    def count_the_end(self, ago_s: float = 0.0) -> None:
        """Let the time limit for the final ramp to zero current begin `ago_s` seconds before now.

        Only the first call has an effect.
        """
        if self._ends_since_s is None:
            self._ends_since_s = self._clock.now() - ago_s

    def watch(self, stop_if_asked: Callable[[], None] = never, early_s: float = 0.0) -> None:
        """Measure the current and check the supply for faults, unless this was done a short time ago.

        Parameters
        ----------
        stop_if_asked : callable
            Called before the measurement; it may raise an exception.
        early_s : float
            Time by which the interval between two measurements is shortened, s.

        Raises
        ------
        InstrumentError
            If the current is wrong in two measurements in a row, or the supply reports a fault or does not answer.
        BeyondInterlock
            If a reading is outside its bounds in two measurements in a row, or does not come for too long.
        """
        measured = bool(self._interlocks) or not self.simulated
        every_s = WATCH_EVERY_S
        if not measured:
            every_s = SIMULATED_CHECK_EVERY_S if self.asked_A else SIMULATED_CHECK_AT_ZERO_EVERY_S
        if self._clock.now() - self._watched_s > every_s - early_s and self._stepping.acquire(blocking=False):
            try:
                self._watched_s = self._clock.now()
                self.check()
                if measured:
                    stop_if_asked()
                    self._compare(self._measure())
            finally:
                self._stepping.release()
        with self._marking_out_of_control():
            self._interlocks.check_silence(self._clock.now())

    def _compare(self, reading: Reading) -> None:
        readings = self._readings(reading)
        if not (self._is_right(reading.current_A) and self._interlocks.hold(readings)):
            self._clock.sleep(MEASURED_AGAIN_AFTER_S)
            reading = self._measure()
            readings = self._readings(reading)
            if not self._is_right(reading.current_A):
                self.out_of_control = True
                raise self._off_target(self._swapped(reading.current_A))
        with self._marking_out_of_control():
            self._interlocks.check(readings, self._clock.now())

    def _readings(self, measured: Reading) -> dict[str, float]:
        """Return the values of the supply by name; also of the sensors if there are interlocks (bounds of readings)."""
        return {**readings_of(measured), **(self._sense() if self._interlocks else {})}

    def check(self) -> None:
        """Raise InstrumentError if the supply reports a fault or does not answer."""
        with self._timed_exchange():
            self.supply.check()

    @contextmanager
    def _timed_exchange(self) -> Iterator[None]:
        """Measure the duration of an exchange with the supply, and store in `unreachable` why the exchange failed."""
        began_s = self._clock.now()
        try:
            yield
            self._took_s.append(self._clock.now() - began_s)
        except (InstrumentTimeout, InstrumentDisconnected, ReplyNotUnderstood) as error:
            self.unreachable = str(error)
            raise

    @contextmanager
    def _marking_out_of_control(self) -> Iterator[None]:
        # Note that a reading exceeded an interlock if the body of the with statement raises BeyondInterlock.
        try:
            yield
        except BeyondInterlock:
            self.out_of_control = True
            raise

    def _swapped(self, current_A: float) -> float:
        """Return the current with the opposite sign if the leads of the coil are swapped; otherwise unchanged."""
        return -current_A if self.leads_swapped and current_A else current_A

    def _is_right(self, of_supply_A: float) -> bool:
        current_A = self._swapped(of_supply_A)
        since_s = self._clock.now() - FOLLOWS_WITHIN_S
        while len(self._recent) > 1 and self._recent[1][0] <= since_s:
            self._recent.popleft()
        set_points_A = [asked_A for _, asked_A in self._recent]
        margin_A = max(self._rule.tolerance_A, 0.0 if any(set_points_A) else off_limit_A(self.supply))
        within_set_points = min(set_points_A) - margin_A <= current_A <= max(set_points_A) + margin_A
        return within_set_points and abs(current_A) <= self.supply.limits.current_A + margin_A

    def _set(self, current_A: float) -> None:
        self.asked_A, sent_s = current_A, self._clock.now()
        self._recent.append((sent_s, current_A))
        with self._timed_exchange():
            self.supply.set_current(self._swapped(current_A))
        self.changed_s = self._clock.now()
        self._note_set_point(sent_s, self.changed_s)

    def _note_set_point(self, sent_s: float, changed_s: float) -> None:
        self._set_points.append(
            SetPoint(0.5 * (sent_s + changed_s), self.asked_A, (changed_s - sent_s) / math.sqrt(12.0))
        )

    def new_set_points(self) -> list[SetPoint]:
        """Return the set-points that were sent since the previous call, with the times of sending."""
        new, self._set_points = self._set_points, []
        return new

    def ramp_to(self, current_A: float, stop_if_asked: Callable[[], None] = never) -> None:
        """Change the current of the coil to `current_A` (A) in a ramp.

        Raises the errors of `PowerSupply.set_current`.
        """
        start = self.asked_A
        steps = math.ceil(round(abs(current_A - start) / self._rule.step_A, 6))
        pause = self._rule.step_A / self._rule.rate_A_per_s
        for step in range(1, steps + 1):
            stop_if_asked()
            began = self._clock.now()
            self._set(current_A if step == steps else round(start + (current_A - start) * step / steps, 6))
            self._pause(pause - (self._clock.now() - began), stop_if_asked)

    def ramp_down(self, stop_if_asked: Callable[[], None] = never) -> None:
        """Ramp the current to zero within the time `ramp.down_within_s` of the protocol.

        If this time is too short, the ramp ends before the current is zero. There is no ramp if a current or a reading
        was wrong, or if the supply does not answer. Raises the errors of `PowerSupply.set_current`.
        """
        if self.out_of_control or self.unreachable:
            return
        start, began = self.asked_A, self._clock.now()
        within_s = self._rule.down_within_s - (0.0 if self._ends_since_s is None else began - self._ends_since_s)
        seconds = min(abs(start) / self._rule.rate_A_per_s, within_s)
        pause = seconds / max(1, math.ceil(round(abs(start) / self._rule.step_A, 6)))
        while self.asked_A and (elapsed := self._clock.now() - began) < seconds:
            stop_if_asked()
            step_s = max(pause, *self._took_s)
            if step_s > pause and elapsed + step_s > seconds:
                return
            self._set(round(start * max(0.0, 1 - (elapsed + step_s) / seconds), 6))
            self._pause(began + elapsed + pause - self._clock.now(), stop_if_asked)

    def _pause(self, seconds: float, stop_if_asked: Callable[[], None]) -> None:
        until, longest_s = self._clock.now() + seconds, POLL_S if self.simulated else HEED_EVERY_S
        while (remaining_s := until - self._clock.now()) > longest_s:
            self._clock.sleep(longest_s)
            stop_if_asked()
        self._clock.sleep(max(0.0, remaining_s))

    def step_to(self, current_A: float) -> SetPoint:
        """Set a current in one step, without a ramp, and measure until the current is reached.

        Returns
        -------
        SetPoint
            The current, the time at which the coil reached it, and the uncertainty of this time.

        Raises
        ------
        InstrumentError
            If the current is not reached within a few seconds, or if the supply fails.
        """
        with self._stepping:
            self._set(current_A)
            step = self._set_points[-1]
            self.wait_until_reached()
            self._watched_s = self._clock.now()
            followed_s = (self._watched_s - self.changed_s) / math.sqrt(12.0)
            return replace(step, uncertainty_s=math.hypot(step.uncertainty_s, followed_s))

    def wait_until_reached(self, stop_if_asked: Callable[[], None] = never) -> None:
        """Wait until the measured current agrees with the set-point within the tolerance of the protocol.

        Raises InstrumentError if this takes longer than a few seconds.
        """
        began = self._clock.now()
        while abs((measured := self._measure_A()) - self.asked_A) > self._rule.tolerance_A:
            stop_if_asked()
            self.check()
            if self._clock.now() - began > REACHED_WITHIN_S:
                self.out_of_control = True
                raise self._off_target(measured)
            if self.simulated:  # one step of the simulated time, so that its later events keep their times
                self._clock.sleep(POLL_S)
            else:
                self._pause(POLL_S, stop_if_asked)

    def measured_A(self) -> float:
        """Measure and return the current of the coil, A.

        Raises InstrumentError if the current differs from the set-point by more than `ramp.tolerance_A`.
        """
        measured = self._measure_A()
        if abs(measured - self.asked_A) > self._rule.tolerance_A:
            self.out_of_control = True
            raise self._off_target(measured)
        return measured

    def _measure(self) -> Reading:
        with self._timed_exchange():
            return self.supply.measure()

    def _measure_A(self) -> float:
        return self._swapped(self._measure().current_A)

    def _off_target(self, measured: float) -> InstrumentError:
        return InstrumentError(
            f"{self.supply.identify().address}: {measured:.3f} A measured at a set-point of {self.asked_A:g} A; the "
            f"difference is more than ramp.tolerance_A = {self._rule.tolerance_A:g}; check that the coil is connected "
            "and that the voltage limit is high enough"
        )
