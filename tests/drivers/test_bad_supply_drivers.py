"""Checks of supply drivers fail for faulty drivers, and their messages name the check."""

from __future__ import annotations

from typing import Any

import pytest

from eimi_drivers.emulators.serve import emulate
from eimi_drivers.interfaces import InstrumentError, Reading
from eimi_drivers.supplies import SUPPLIES
from eimi_drivers.testing import check_supply
from eimi_drivers.testing.supply_checks import SUPPLY_CHECKS

Scpi: Any = SUPPLIES["scpi"]


class GivesUpAfterTheFirst(Scpi):
    # A faulty supply driver whose `safe_off` stops after its first message has failed.

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
    # A faulty supply driver: its `close` switches the output off, but must leave it unchanged.

    def close(self) -> None:
        self._send_output(False)
        super().close()


class LastReading(Scpi):
    # A faulty supply driver that returns the last measured values if the supply does not answer.

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


BAD: list[tuple[str, type]] = [
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


@pytest.mark.parametrize(("name", "driver"), BAD, ids=[f"{name}-{driver.__name__}" for name, driver in BAD])
def test_a_bad_driver_fails_its_check(name: str, driver: type) -> None:
    checks = [check for check in SUPPLY_CHECKS if check.__name__ == name]
    assert checks

    def emulated(coil: Any) -> Any:
        return emulate("scpi", coil)

    with pytest.raises(AssertionError, match=name):
        check_supply(driver, emulated, checks=checks)
