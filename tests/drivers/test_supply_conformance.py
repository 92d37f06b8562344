"""Every supply driver passes the checks for every driver on every kind of connection."""

from __future__ import annotations

import pytest

from eimi_drivers.emulators import DIALECTS
from eimi_drivers.emulators.faults import Fault
from eimi_drivers.interfaces import (
    InstrumentDisconnected,
    InstrumentError,
    InstrumentTimeout,
    PowerSupply,
    SetPointRefused,
    SwitchOffFailed,
)
from eimi_drivers.testing import SUPPLY_CHECKS, supply_checks

WAITING = (
    supply_checks.notices_a_locked_front_panel,
    supply_checks.tries_every_stage_of_switching_off,
    supply_checks.gives_up_on_a_silent_line,
    supply_checks.understands_no_half_answers,
    supply_checks.takes_no_late_answer_for_the_next,
)
"""Checks of the conformance suite that take seconds on a real port."""


@pytest.mark.parametrize("check", [check for check in SUPPLY_CHECKS if check not in WAITING])
def test_every_driver_conforms(link, conforms, check):
    conforms(link, check)


@pytest.mark.parametrize("check", WAITING)
def test_every_driver_conforms_to_the_checks_that_wait(waiting_link, conforms, check):
    conforms(waiting_link, check)


def test_the_identity_contains_the_answer_of_the_instrument(bench):
    identity = bench.supply.identify()
    assert identity.driver == bench.supply.name
    expected = DIALECTS[bench.supply.name].identification
    assert identity.text == (expected.decode() if isinstance(expected, bytes) else expected)
    assert isinstance(bench.supply, PowerSupply)


@pytest.mark.parametrize("value", [-1.0001, 1.0001, float("nan"), float("inf"), -float("inf")])
def test_a_refused_set_point_is_reported_with_the_permitted_range(bench, value):
    with pytest.raises(SetPointRefused, match=rf"{bench.address}.*must be from (0|-1) to 1 A"):
        bench.supply.set_current(value)
    with pytest.raises(SetPointRefused, match=rf"{bench.address}.*must be from 0 to 12 V"):
        bench.supply.set_voltage(value * 12)


def test_a_set_point_that_is_not_taken_is_reported_with_its_read_back(bench):
    bench.coil.max_current_A = 0.5
    with pytest.raises(InstrumentError, match=r"reads back 0 A|-222 Data out of range|C05|error 100"):
        bench.supply.set_current(0.7)


def test_switching_off_a_locked_supply_reports_every_stage(waiting_bench):
    waiting_bench.energise()
    waiting_bench.coil.locked = True
    with pytest.raises(InstrumentError, match=r"0\.7|203|error 200"):
        waiting_bench.supply.set_current(0.2)
    assert waiting_bench.coil.state.set_current_A == 0.7
    with pytest.raises(SwitchOffFailed, match=r"zero: failed.*read back: failed"):
        waiting_bench.supply.safe_off()


def test_a_cut_line_is_reported_with_its_cause(bench):
    bench.energise()
    bench.line.inject(Fault.DISCONNECT)
    # PyVISA reports a socket that the other side has closed as a timeout.
    with pytest.raises((InstrumentDisconnected, InstrumentTimeout), match=bench.address) as caught:
        bench.supply.measure()
    assert caught.value.__cause__ is not None
    with pytest.raises(SwitchOffFailed, match=r"zero: failed.*off: .*read back: failed"):
        bench.supply.safe_off()


def test_an_oscillating_current_appears_in_the_readings(quick_bench):
    quick_bench.energise()
    quick_bench.coil.hunting_A = 0.1
    readings = []
    for _ in range(20):
        quick_bench.clock.sleep(0.1)
        readings.append(quick_bench.supply.measure().current_A)
    assert max(readings) - min(readings) > 0.1
    quick_bench.supply.safe_off()
    assert not quick_bench.energised()
