"""Checks of the conformance suite fail for a faulty supply driver, and the message names the check."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from eimi_drivers.emulators.serve import emulate
from eimi_drivers.interfaces import Identity, InstrumentError, Limits, Reading, ReplyNotUnderstood, SwitchOffFailed
from eimi_drivers.supplies import SUPPLIES
from eimi_drivers.testing import check_supply
from eimi_drivers.testing.supply_checks import SUPPLY_CHECKS

Scpi: Any = SUPPLIES["scpi"]


class GivesUpAfterTheFirst(Scpi):
    """A faulty supply driver whose `safe_off` sends nothing more after its first message has failed."""

    def safe_off(self) -> Any:
        self.set_current(0.0)
        return super().safe_off()


class LeavesTheOutputOn(Scpi):
    def safe_off(self) -> Any:
        self.set_current(0.0)


class LeavesTheSetPoint(Scpi):
    def safe_off(self) -> Any:
        self.set_output(False)


class ClosesByTheOutput(Scpi):
    """A faulty supply driver that switches the output off when the line is closed; `close` must change nothing."""

    def close(self) -> None:
        self._send_output(False)
        super().close()


class LastReading(Scpi):
    """A faulty supply driver that returns the last measured values if the instrument does not answer."""

    last: Reading | None = None

    def measure(self) -> Reading:
        try:
            self.last = super().measure()
        except InstrumentError:
            if self.last is None:
                return Reading(0.0, 0.0)
        assert self.last is not None
        return self.last


class HalfTheCurrent(Scpi):
    def measure(self) -> Reading:
        reading = super().measure()
        return Reading(0.5 * reading.current_A, reading.voltage_V)


class NoLimits(Scpi):
    def _refuse_outside(self, *_: object) -> None:
        pass


class AlwaysOff(Scpi):
    def output_on(self) -> bool:
        super().output_on()
        return False


def identified_as(change: Callable[[Identity], Any]) -> type:
    class Driver(Scpi):
        def identify(self) -> Any:
            return change(super().identify())

    return Driver


class AlwaysOn(Scpi):
    def output_on(self) -> bool:
        super().output_on()
        return True


class StaysOn(Scpi):
    """A faulty supply driver whose `set_output(False)` does nothing."""

    def set_output(self, on: bool) -> None:
        if on:
            super().set_output(on)


class HalfTheSetPoint(Scpi):
    def set_current(self, current_A: float) -> None:
        super().set_current(0.5 * current_A)


class WiderLimits(Scpi):
    def __init__(self, link: Any, limits: Limits, clock: Any) -> None:
        super().__init__(link, Limits(2 * limits.current_A, limits.voltage_V), clock)


class SendsBeforeItRefuses(Scpi):
    def _refuse_outside(self, *arguments: Any) -> None:
        self._send("*CLS")
        super()._refuse_outside(*arguments)


class OneWayOnly(Scpi):
    """A faulty supply driver that declares a bipolar supply and refuses negative currents."""

    bipolar = True

    def set_current(self, current_A: float) -> None:
        self._refuse_outside("current", current_A, 0.0, self.limits.current_A, "A")
        super().set_current(current_A)


class ReadsNothingBack(Scpi):
    """A faulty supply driver that verifies neither set-points nor the output, and asks for no errors."""

    def _verify(self, *_: object) -> None:
        pass

    def _verify_output(self, on: bool) -> None:
        pass

    def _raise_reported_errors(self) -> None:
        pass


class ReadsTheVoltageBack(ReadsNothingBack):
    def _verify(self, quantity: Any, *arguments: Any) -> None:
        if quantity == "voltage":
            super(ReadsNothingBack, self)._verify(quantity, *arguments)


class ReadsTheCurrentBack(ReadsNothingBack):
    def _verify(self, quantity: Any, *arguments: Any) -> None:
        if quantity == "current":
            super(ReadsNothingBack, self)._verify(quantity, *arguments)


class SwitchesOffSilently(Scpi):
    """A faulty supply driver that reports no failure of switching off."""

    def safe_off(self) -> Any:
        try:
            return super().safe_off()
        except SwitchOffFailed:
            return None


class SeesNoTrip(Scpi):
    def check(self) -> None:
        pass


class UnderstandsAnything(Scpi):
    def identify(self) -> Any:
        try:
            return super().identify()
        except ReplyNotUnderstood:
            return Identity("scpi", "?", self._link.address)


class IsOffendedByGarbage(Scpi):
    """A faulty supply driver that answers no query after an answer that it did not understand."""

    offended = False

    def identify(self) -> Any:
        try:
            return super().identify()
        except ReplyNotUnderstood:
            self.offended = True
            raise

    def output_on(self) -> bool:
        return super().output_on() or self.offended


class SwitchesOnWhenOpened(Scpi):
    def __init__(self, link: Any, limits: Limits, clock: Any) -> None:
        super().__init__(link, limits, clock)
        self._send_voltage("3.000")


class SaysOff(ReadsNothingBack):
    """A faulty supply driver that reports every output as off."""

    def output_on(self) -> bool:
        super().output_on()
        return False


class SaysOffBothWays(SaysOff):
    bipolar = True


class SaysOn(AlwaysOn, ReadsNothingBack):
    """A faulty supply driver that reports every output as on."""


class ChangesBeforeItRefuses(Scpi):
    def _refuse_outside(self, *arguments: Any) -> None:
        self._send("CURR 0.123")
        super()._refuse_outside(*arguments)


class NeverOff(Scpi):
    """A faulty supply driver whose `safe_off` does nothing if the output is on."""

    def safe_off(self) -> Any:
        if not self.output_on():
            super().safe_off()


class DoesNothing(Scpi):
    def safe_off(self) -> Any:
        pass


class LastState(Scpi):
    """A faulty supply driver that reports the output as off if the instrument does not answer."""

    def output_on(self) -> bool:
        try:
            return super().output_on()
        except InstrumentError:
            return False


class Slow(Scpi):
    """A faulty supply driver that asks for 6 s before it gives up."""

    def output_on(self) -> bool:
        self._clock.sleep(6.0)
        return super().output_on()


class ReadsTuples(Scpi):
    def measure(self) -> Any:
        reading = super().measure()
        return reading.current_A, reading.voltage_V


class ClosesOnce(Scpi):
    closed = False

    def close(self) -> None:
        if self.closed:
            raise InstrumentError("closed already")
        self.closed = True
        super().close()


BAD: list[tuple[str, type]] = [
    ("says_who_it_is", identified_as(lambda identity: identity.text)),
    ("says_who_it_is", identified_as(lambda identity: replace(identity, text=""))),
    ("says_who_it_is", identified_as(lambda identity: replace(identity, driver=""))),
    ("says_who_it_is", identified_as(lambda identity: replace(identity, address="elsewhere"))),
    ("drives_the_coil_and_switches_it_off", AlwaysOff),
    ("drives_the_coil_and_switches_it_off", AlwaysOn),
    ("drives_the_coil_and_switches_it_off", StaysOn),
    ("drives_the_coil_and_switches_it_off", HalfTheSetPoint),
    ("refuses_set_points_outside_its_limits", WiderLimits),
    ("refuses_set_points_outside_its_limits", SendsBeforeItRefuses),
    ("reverses_its_current_only_if_it_is_bipolar", NoLimits),
    ("reverses_its_current_only_if_it_is_bipolar", SendsBeforeItRefuses),
    ("reverses_its_current_only_if_it_is_bipolar", OneWayOnly),
    ("reads_its_set_points_back", ReadsTheVoltageBack),
    ("reads_its_set_points_back", ReadsTheCurrentBack),
    ("notices_a_locked_front_panel", ReadsNothingBack),
    ("notices_a_locked_front_panel", SwitchesOffSilently),
    ("notices_a_locked_front_panel", StaysOn),
    ("reports_a_protection_trip", SeesNoTrip),
    ("drives_the_coil_and_switches_it_off", SaysOff),
    ("drives_the_coil_and_switches_it_off", SaysOn),
    ("drives_the_coil_and_switches_it_off", ReadsTuples),
    ("refuses_set_points_outside_its_limits", ChangesBeforeItRefuses),
    ("reverses_its_current_only_if_it_is_bipolar", SaysOffBothWays),
    ("is_off_after_safe_off_from_every_state", NeverOff),
    ("tries_every_stage_of_switching_off", DoesNothing),
    ("gives_up_on_a_silent_line", LastState),
    ("gives_up_on_a_silent_line", Slow),
    ("takes_no_late_answer_for_the_next", SaysOff),
    ("leaves_the_output_alone_when_it_is_opened_or_closed", SaysOff),
    ("is_off_after_safe_off_from_every_state", AlwaysOn),
    ("gives_up_on_a_silent_line", AlwaysOn),
    ("understands_no_garbage", UnderstandsAnything),
    ("understands_no_garbage", IsOffendedByGarbage),
    ("reports_a_cut_line", SwitchesOffSilently),
    ("leaves_the_output_alone_when_it_is_opened_or_closed", SwitchesOnWhenOpened),
    ("leaves_the_output_alone_when_it_is_opened_or_closed", ClosesOnce),
    ("tries_every_stage_of_switching_off", GivesUpAfterTheFirst),
    ("is_off_after_safe_off_from_every_state", LeavesTheOutputOn),
    ("is_off_after_safe_off_from_every_state", LeavesTheSetPoint),
    ("drives_the_coil_and_switches_it_off", HalfTheCurrent),
    ("refuses_set_points_outside_its_limits", NoLimits),
    ("gives_up_on_a_silent_line", LastReading),
    ("understands_no_half_answers", LastReading),
    ("waits_for_a_slow_answer", HalfTheCurrent),
    ("reports_a_cut_line", LastReading),
    ("leaves_the_output_alone_when_it_is_opened_or_closed", ClosesByTheOutput),
    ("leaves_the_output_alone_when_it_is_opened_or_closed", AlwaysOff),
    ("takes_no_late_answer_for_the_next", AlwaysOff),
]


def test_every_check_has_a_bad_driver() -> None:
    assert {name for name, _ in BAD} == {check.__name__ for check in SUPPLY_CHECKS}


@pytest.mark.parametrize(("name", "driver"), BAD, ids=[f"{name}-{driver.__name__}" for name, driver in BAD])
def test_a_bad_driver_fails_its_check(name: str, driver: type) -> None:
    checks = [check for check in SUPPLY_CHECKS if check.__name__ == name]
    assert checks

    def emulated(coil: Any) -> Any:
        coil.bipolar = driver.bipolar  # type: ignore[attr-defined]
        return emulate("scpi", coil)

    with pytest.raises(AssertionError, match=name):
        check_supply(driver, emulated, checks=checks)
