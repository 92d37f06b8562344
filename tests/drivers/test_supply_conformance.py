"""What every supply driver does, over every transport."""

from __future__ import annotations

import pytest

from eimi_drivers.emulators import DIALECTS
from eimi_drivers.emulators.faults import Fault
from eimi_drivers.interfaces import (
    InstrumentDisconnected,
    InstrumentError,
    InstrumentTimeout,
    PowerSupply,
    ProtectionTripped,
    ReplyNotUnderstood,
    SetPointRefused,
    SwitchOffFailed,
)
from eimi_drivers.supplies import SUPPLIES


def test_says_who_it_is(bench):
    identity = bench.supply.identify()
    assert identity.driver == bench.driver
    assert identity.address == bench.address
    expected = DIALECTS[bench.driver].identification
    assert identity.text == (expected.decode() if isinstance(expected, bytes) else expected)
    assert isinstance(bench.supply, PowerSupply)


def test_drives_the_coil_and_switches_it_off(bench):
    bench.energise(0.7)
    assert bench.supply.output_on()
    reading = bench.supply.measure()
    assert reading.current_A == pytest.approx(0.7, abs=0.001)
    assert reading.voltage_V == pytest.approx(0.7 * 4.0, abs=0.01)
    assert bench.coil.coil_current_A() == pytest.approx(0.7, abs=1e-4)
    bench.supply.check()

    bench.supply.set_current(0.2)
    bench.clock.sleep(0.2)
    assert bench.supply.measure().current_A == pytest.approx(0.2, abs=0.001)

    bench.supply.safe_off()
    assert not bench.energised()
    assert not bench.supply.output_on()
    assert bench.coil.state.set_current_A == 0.0
    bench.clock.sleep(0.2)
    assert bench.coil.coil_current_A() == pytest.approx(0.0, abs=1e-4)
    bench.supply.check()  # off because it was told to be: no fault


@pytest.mark.parametrize("value", [-1.0001, 1.0001, float("nan"), float("inf"), -float("inf")])
def test_refused_set_points_change_nothing(bench, value):
    before = bench.coil.state
    with pytest.raises(SetPointRefused, match=r"must be from (0|-1) to 1 A"):
        bench.supply.set_current(value)
    with pytest.raises(SetPointRefused, match="must be from 0 to 12 V"):
        bench.supply.set_voltage(value * 12)
    assert bench.coil.state == before
    assert bench.sent == []


def test_negative_currents_are_for_bipolar_supplies(bench):
    if not SUPPLIES[bench.driver].bipolar:
        with pytest.raises(SetPointRefused, match="must be from 0 to 1 A"):
            bench.supply.set_current(-0.001)
        assert bench.sent == []
        return
    bench.energise(-0.7)
    assert bench.supply.output_on()
    assert bench.supply.measure().current_A == pytest.approx(-0.7, abs=0.001)
    bench.supply.safe_off()
    assert bench.coil.state.set_current_A == 0.0


def test_a_protection_trip_is_reported(bench):
    bench.energise()
    bench.coil.trip()
    with pytest.raises(ProtectionTripped, match=bench.address):
        bench.supply.check()


def test_silence_is_a_timeout(waiting_bench):
    waiting_bench.line.inject(Fault.SILENCE)
    with pytest.raises(InstrumentTimeout, match=waiting_bench.address):
        waiting_bench.supply.output_on()


def test_garbage_is_not_understood_and_is_not_taken_for_the_next_answer(bench):
    bench.line.inject(Fault.GARBAGE)
    with pytest.raises(ReplyNotUnderstood, match=bench.address):
        bench.supply.identify()
    bench.line.inject(None)
    assert not bench.supply.output_on()


def test_half_an_answer_is_a_driver_error(waiting_bench):
    waiting_bench.energise()
    waiting_bench.line.inject(Fault.PARTIAL)
    with pytest.raises((InstrumentTimeout, ReplyNotUnderstood), match=waiting_bench.address):
        waiting_bench.supply.measure()
    waiting_bench.line.inject(None)
    assert waiting_bench.supply.measure().current_A == pytest.approx(0.7, abs=0.001)


def test_an_answer_that_is_slow_is_waited_for(bench):
    bench.energise()
    bench.line.inject(Fault.SLOW)
    assert bench.supply.measure().current_A == pytest.approx(0.7, abs=0.001)


def test_an_answer_that_comes_too_late_is_not_taken_for_the_next_one(waiting_bench):
    waiting_bench.energise()
    waiting_bench.line.late_s = 1.3
    waiting_bench.line.inject(Fault.SLOW)
    with pytest.raises(InstrumentTimeout, match=waiting_bench.address):
        waiting_bench.supply.measure()
    waiting_bench.line.inject(None)
    assert waiting_bench.supply.output_on()  # which no answer to another question says
    reading = waiting_bench.supply.measure()
    assert (reading.current_A, reading.voltage_V) == pytest.approx((0.7, 2.8), abs=0.01)


def test_a_locked_front_panel_is_noticed_at_the_first_set_point(waiting_bench):
    waiting_bench.energise()
    waiting_bench.coil.locked = True
    with pytest.raises(InstrumentError, match=r"0\.7|203"):
        waiting_bench.supply.set_current(0.2)
    assert waiting_bench.coil.state.set_current_A == 0.7
    with pytest.raises(SwitchOffFailed, match=r"zero: failed.*verify: failed"):
        waiting_bench.supply.safe_off()


def test_a_current_that_never_settles_shows_in_the_readings(quick_bench):
    quick_bench.energise()
    quick_bench.coil.hunting_A = 0.1
    readings = []
    for _ in range(20):
        quick_bench.clock.sleep(0.1)
        readings.append(quick_bench.supply.measure().current_A)
    assert max(readings) - min(readings) > 0.1
    quick_bench.supply.safe_off()
    assert not quick_bench.energised()


def test_a_cut_line_is_reported_with_its_cause(bench):
    bench.energise()
    bench.line.inject(Fault.DISCONNECT)
    # A socket that the other side closed is, to PyVISA, one on which nothing comes.
    with pytest.raises((InstrumentDisconnected, InstrumentTimeout), match=bench.address) as caught:
        bench.supply.measure()
    assert caught.value.__cause__ is not None
    with pytest.raises(SwitchOffFailed, match=r"zero: failed.*off: .*verify: failed"):
        bench.supply.safe_off()


def test_a_set_point_beyond_the_instrument_is_not_taken_for_set(bench):
    bench.coil.max_current_A = 0.5
    with pytest.raises(InstrumentError, match=r"reads back 0 A|-222 Data out of range|C05"):
        bench.supply.set_current(0.7)


def test_closing_twice_is_allowed_and_leaves_the_output_alone(bench):
    bench.energise()
    bench.supply.close()
    bench.supply.close()
    assert bench.energised()
