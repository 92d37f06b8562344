"""The simulated supply with its coil agrees with formulas, also after a protection of the supply acts."""

from __future__ import annotations

import math
from typing import Any

import pytest

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators.faults import (
    DRIFTS_TO_A,
    HUNTING_A,
    OFFSET_A,
    RESTARTS_WITHIN_S,
    SHORTED_A,
    SLEEPS_FOR_S,
    Fault,
    FaultyInstrument,
)
from eimi_drivers.emulators.output_watchdog import OutputWatchdog
from eimi_drivers.emulators.serve import emulate
from eimi_drivers.emulators.spoiling import OTHER_SERIAL_NUMBER, another_unit, begin_fault, end_faults
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.emulators.trip_level import TripLevel
from eimi_drivers.interfaces import InstrumentError

STEADY_S = 50.0


def energised(current_A: float = 0.8, voltage_V: float = 12.0, **options: Any) -> CoilSupply:
    # Return a supply that has driven a constant current through a coil of 4 ohm for a long time.
    clock = SimulatedClock()
    coil = CoilSupply(clock, resistance_ohm=4.0, time_constant_s=0.5, **options)
    coil.bipolar = True
    assert coil.set_voltage(voltage_V)
    assert coil.set_current(current_A)
    assert coil.switch(True)
    clock.sleep(STEADY_S)
    return coil


def test_a_new_supply_is_off_with_zero_set_points_and_no_fault() -> None:
    coil = CoilSupply(SimulatedClock())
    assert (coil.bipolar, coil.locked, coil.fallen) == (False, False, False)
    assert (coil.hunting_A, coil.shorted_A, coil.offset_A) == (0.0, 0.0, 0.0)
    state = coil.state
    assert (state.output, state.armed, state.tripped, state.set_current_A, state.set_voltage_V) == (
        *(False, False, False),
        *(0.0, 0.0),
    )
    assert state.trip_current_A == state.trip_voltage_V == math.inf
    reading = coil.read()
    assert (reading.current_A, reading.voltage_V) == (0.0, 0.0)


@pytest.mark.parametrize("name", ["resistance_ohm", "time_constant_s", "thermal_time_constant_s"])
@pytest.mark.parametrize("value", [0.0, -1.0])
def test_a_coil_without_resistance_or_time_is_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match="must be greater than 0"):
        CoilSupply(SimulatedClock(), **{name: value})  # type: ignore[arg-type]


def test_set_points_are_accepted_up_to_and_including_the_bounds() -> None:
    coil = CoilSupply(SimulatedClock(), max_current_A=2.0, max_voltage_V=10.0)
    for value, taken in ((2.0, True), (2.001, False), (0.0, True), (-0.001, False)):
        assert coil.set_current(value) is taken
    for value, taken in ((10.0, True), (10.001, False), (0.0, True), (-0.001, False)):
        assert coil.set_voltage(value) is taken
    coil.bipolar = True
    for value, taken in ((-2.0, True), (-2.001, False)):
        assert coil.set_current(value) is taken
    assert (coil.state.set_current_A, coil.state.set_voltage_V) == (-2.0, 0.0)


@pytest.mark.parametrize("sign", [1, -1])
def test_the_voltage_bounds_the_current_of_both_signs(sign: int) -> None:
    coil = energised(sign * 0.8, 2.0)
    assert coil.coil_current_A() == pytest.approx(sign * 0.5)
    assert coil.constant_voltage()
    assert coil.read().voltage_V == pytest.approx(sign * 2.0)
    assert not energised(sign * 0.5, 2.0).constant_voltage()  # the current is exactly at the bound


def test_a_locked_supply_obeys_no_command() -> None:
    coil = energised()
    coil.locked = True
    before = coil.state
    taken = (coil.set_current(0.1), coil.set_voltage(1.0), coil.switch(False), coil.arm(True), coil.clear_trip())
    assert not any((*taken, coil.reset(), coil.set_trip_levels(current_A=0.1, voltage_V=0.1)))
    assert coil.state == before
    coil.locked = False
    assert coil.switch(False)


def test_the_current_at_an_earlier_time_is_the_current_that_flowed_then() -> None:
    coil = energised(0.8)
    coil.set_current(0.2)
    changed_s = coil.clock.now()
    coil.clock.sleep(2.0)
    for age_s in (0.0, 0.5, 2.0):
        expected_A = 0.2 + 0.6 * math.exp(-age_s / 0.5)
        assert coil.coil_current_at_A(changed_s + age_s) == pytest.approx(expected_A)
    assert coil.coil_current_at_A(changed_s - 1.0) == pytest.approx(0.8)


@pytest.mark.parametrize("fault", ["hunting_A", "fallen", "shorted_A", "drift"])
def test_with_a_faulty_current_an_earlier_time_has_the_present_current(fault: str) -> None:
    coil = energised(0.8)
    coil.set_current(0.2)
    changed_s = coil.clock.now()
    if fault == "drift":
        coil.drift(2.0)
    else:
        setattr(coil, fault, 1.1)
    coil.clock.sleep(1.7)
    assert coil.coil_current_at_A(changed_s + 0.1) == coil.coil_current_A()


def test_a_hunting_current_swings_with_its_amplitude_at_0_7_Hz() -> None:
    coil = energised(0.8)
    coil.hunting_A = 0.2
    for _ in range(25):
        coil.clock.sleep(0.13)
        expected_A = 0.8 + 0.2 * math.sin(2 * math.pi * 0.7 * coil.clock.now())
        assert coil.coil_current_A() == pytest.approx(expected_A, abs=1e-9)
    coil.set_current(0.0)
    coil.clock.sleep(STEADY_S)
    assert coil.coil_current_A() == 0.0
    coil.set_current(0.8)
    coil.switch(False)
    coil.clock.sleep(STEADY_S)
    assert coil.coil_current_A() == 0.0


def test_a_drifting_current_rises_at_its_rate_up_to_its_end() -> None:
    coil = energised(0.8)
    coil.drift(2.4, 0.5)
    for after_s, expected_A in ((0.0, 0.8), (1.0, 1.3), (3.2, 2.4), (10.0, 2.4)):
        coil.clock.sleep(after_s - (coil.clock.now() - STEADY_S))
        assert coil.coil_current_A() == pytest.approx(expected_A)
    assert coil.state.set_current_A == 0.8
    coil.switch(False)
    assert coil.coil_current_A() <= 0.8  # the decaying current does not drift
    coil.clock.sleep(STEADY_S)
    assert coil.coil_current_A() == 0.0
    coil.switch(True)
    coil.drift(0.0, 0.0)
    coil.clock.sleep(STEADY_S)
    assert coil.coil_current_A() == pytest.approx(0.8)


def test_a_drift_below_the_set_point_changes_nothing() -> None:
    coil = energised(0.8)
    coil.drift(0.5)
    coil.clock.sleep(5.0)
    assert coil.coil_current_A() == pytest.approx(0.8)


def test_a_shorted_regulator_carries_at_least_its_current() -> None:
    coil = energised(0.2)
    coil.shorted_A = 0.8
    assert coil.coil_current_A() == 0.8
    coil.set_current(1.5)
    coil.clock.sleep(STEADY_S)
    assert coil.coil_current_A() == pytest.approx(1.5)
    coil.switch(False)
    coil.clock.sleep(STEADY_S)
    assert coil.coil_current_A() == 0.8
    assert not coil.output_on()


def test_an_output_that_failed_reads_back_as_on_without_a_current() -> None:
    coil = energised(0.8)
    coil.fallen = True
    assert (coil.coil_current_A(), coil.output_on(), coil.state.set_current_A) == (0.0, True, 0.8)


def test_an_offset_of_the_meter_changes_the_reading_only() -> None:
    coil = energised(0.8)
    coil.offset_A = 0.015
    assert coil.read().current_A == pytest.approx(0.815)
    assert coil.coil_current_A() == pytest.approx(0.8)


@pytest.mark.parametrize("quantity", ["current_A", "voltage_V"])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_protection_trips_above_its_level_only(quantity: str, sign: int) -> None:
    coil = energised(sign * 0.8)
    level = {"current_A": 0.8, "voltage_V": 3.2}[quantity]
    coil.set_trip_levels(**{quantity: level + 1e-6})
    assert coil.output_on()
    assert not coil.state.tripped
    coil.set_trip_levels()
    assert coil.state.trip_current_A == (level + 1e-6 if quantity == "current_A" else math.inf)
    coil.set_trip_levels(**{quantity: level - 1e-6})
    assert not coil.output_on()
    assert coil.state.tripped
    coil.clear_trip()
    assert (coil.state.tripped, coil.state.output) == (False, False)
    assert coil.output_on() is False  # no protection acts on an output that is off
    assert not coil.state.tripped


def test_an_armed_protection_acts_just_below_the_set_point() -> None:
    coil = energised(0.8, 4.0 * 0.8 * 0.98)
    coil.arm(True)
    assert coil.output_on()
    coil.set_voltage(4.0 * 0.8 * 0.995)
    coil.clock.sleep(STEADY_S)
    assert not coil.output_on()


def test_switching_on_clears_a_trip_and_switching_off_does_not() -> None:
    coil = energised()
    coil.trip()
    assert (coil.state.output, coil.state.tripped) == (False, True)
    coil.switch(False)
    assert coil.state.tripped
    coil.switch(True)
    assert (coil.state.output, coil.state.tripped) == (True, False)


@pytest.mark.parametrize("restart", [True, False])
def test_reset_and_restart_switch_off_and_clear(restart: bool) -> None:
    coil = energised()
    coil.arm(True)
    coil.set_trip_levels(current_A=1.0, voltage_V=13.0)
    coil.trip()
    if restart:
        coil.restart()
    else:
        assert coil.reset(1.5)
    state = coil.state
    assert (state.output, state.tripped, state.set_voltage_V) == (False, False, 0.0)
    assert state.set_current_A == (0.0 if restart else 1.5)
    assert state.armed is not restart
    assert (state.trip_current_A, state.trip_voltage_V) == ((math.inf, math.inf) if restart else (1.0, 13.0))


def test_noise_of_current_and_voltage_have_their_own_standard_deviations() -> None:
    coil = energised(0.8, current_noise_A=0.01, voltage_noise_V=0.2)
    readings = [coil.read() for _ in range(2000)]
    for values, mean, sigma in (
        ([reading.current_A for reading in readings], 0.8, 0.01),
        ([reading.voltage_V for reading in readings], 3.2, 0.2),
    ):
        assert sum(values) / 2000 == pytest.approx(mean, abs=5 * sigma / math.sqrt(2000))
        spread = math.sqrt(sum((value - mean) ** 2 for value in values) / 2000)
        assert spread == pytest.approx(sigma, rel=0.1)


def test_a_level_is_kept_while_its_protection_is_off() -> None:
    coil = CoilSupply(SimulatedClock())
    protection = TripLevel(coil, "current_A", 2.0, highest=3.0, on=False)
    assert (protection.level, protection.on, coil.state.trip_current_A) == (2.0, False, math.inf)
    assert coil.state.trip_voltage_V == math.inf
    assert [protection.set_level(level) for level in (3.0, 3.001, 0.0, -1.0)] == [True, False, False, False]
    assert (protection.level, coil.state.trip_current_A) == (3.0, math.inf)
    assert protection.switch(True)
    assert (protection.on, coil.state.trip_current_A) == (True, 3.0)
    coil.locked = True
    assert not protection.switch(False)
    assert not protection.set_level(1.0)
    assert (protection.level, protection.on, coil.state.trip_current_A) == (3.0, True, 3.0)
    TripLevel(coil, "voltage_V", 13.0)


@pytest.mark.parametrize("quantity", ["current_A", "voltage_V"])
def test_a_protection_is_on_by_default(quantity: str) -> None:
    coil = CoilSupply(SimulatedClock())
    protection = TripLevel(coil, quantity, 13.0)  # type: ignore[arg-type]
    assert protection.on
    assert getattr(coil.state, f"trip_{quantity}") == 13.0
    assert protection.set_level(1e9)


def test_a_timer_acts_after_its_time_on_an_output_that_is_on() -> None:
    coil = energised()
    timer = OutputWatchdog(coil, 2.0)
    coil.clock.sleep(3.0)
    assert not timer.watch()  # the timer is not switched on
    assert timer.switch(True)
    timer.restart()
    coil.clock.sleep(2.0)
    assert not timer.watch()
    assert not timer.expired
    coil.clock.sleep(0.01)
    assert timer.watch()
    assert (timer.expired, timer.on) == (True, True)
    assert (coil.state.output, coil.state.tripped) == (False, True)
    assert not timer.watch()  # the output is off
    timer.switch(True)
    assert not timer.expired
    assert [timer.set_seconds(value, 1.0, 5.0) for value in (1.0, 5.0, 0.99, 5.01)] == [True, True, False, False]
    assert timer.seconds == 5.0


def echo() -> tuple[SimulatedClock, FaultyInstrument]:
    class Echo:
        def receive(self, data: bytes) -> bytes:
            return data

    clock = SimulatedClock()
    return clock, FaultyInstrument(Echo(), clock)


def test_a_line_without_fault_changes_nothing() -> None:
    clock, line = echo()
    assert line.receive(b"12345678") == b"12345678"
    assert clock.now() == 0.0
    assert not line.lost


@pytest.mark.parametrize(
    ("fault", "answer"),
    [
        (Fault.SILENCE, b""),
        (Fault.PARTIAL, b"1234"),
        (Fault.GARBAGE, FaultyInstrument.garbage),
        (Fault.SLOW, b"12345678"),
    ],
)
def test_a_fault_of_the_line_concerns_the_chosen_messages_until_it_ends(fault: Fault, answer: bytes) -> None:
    clock, line = echo()
    line.inject(fault, lambda data: data.startswith(b"1"))
    assert line.receive(b"other") == b"other"
    assert clock.now() == 0.0
    assert line.receive(b"12345678") == answer
    assert clock.now() == (line.late_s if fault is Fault.SLOW else 0.0)
    line.inject(None)
    assert line.receive(b"12345678") == b"12345678"


@pytest.mark.parametrize("fault", [Fault.SLOW, Fault.GARBAGE])
def test_a_message_without_an_answer_stays_without_one(fault: Fault) -> None:
    clock = SimulatedClock()
    line = FaultyInstrument(emulate("scpi", CoilSupply(clock)), clock)
    line.inject(fault)
    assert line.receive(b"VOLT 5\n") == b""
    assert clock.now() == 0.0


def test_a_supply_that_sleeps_answers_again_after_its_time() -> None:
    clock, line = echo()
    line.inject(Fault.SLEEP)
    assert line.receive(b"1") == b""
    clock.sleep(SLEEPS_FOR_S - 0.01)
    assert line.receive(b"1") == b""
    clock.sleep(0.01)
    assert line.receive(b"1") == b"1"


def test_a_dropped_line_is_cut_once_and_a_lost_line_stays_cut_until_it_is_reconnected() -> None:
    _, line = echo()
    line.inject(Fault.DROP)
    with pytest.raises(ConnectionResetError):
        line.receive(b"1")
    assert (line.receive(b"1"), line.lost) == (b"1", False)
    for fault in (Fault.DISCONNECT, Fault.REENUMERATE):
        line.inject(fault)
        for _ in range(2):
            with pytest.raises(ConnectionResetError):
                line.receive(b"1")
        assert line.lost
        line.inject(None)
        with pytest.raises(ConnectionResetError):
            line.receive(b"1")
        line.reconnect()
        assert (line.receive(b"1"), line.lost) == (b"1", False)


EFFECTS = {
    Fault.SHORTED: ("shorted_A", 0.8),
    Fault.FALLEN: ("fallen", True),
    Fault.OFFSET: ("offset_A", 0.015),
    Fault.LOCKED: ("locked", True),
    Fault.HUNTING: ("hunting_A", 0.2),
}


@pytest.mark.parametrize("fault", EFFECTS)
def test_a_fault_of_the_supply_has_its_effect_until_it_ends(fault: Fault) -> None:
    coil = energised()
    line = FaultyInstrument(emulate("scpi", coil), coil.clock)
    begin_fault(fault, "scpi", coil, line)
    name, value = EFFECTS[fault]
    assert getattr(coil, name) == value
    end_faults(coil, line)
    assert not getattr(coil, name)
    assert (SHORTED_A, OFFSET_A, HUNTING_A, DRIFTS_TO_A) == (
        0.8,
        0.015,
        0.2,
        2.4,
    )  # the values in the help of `eimi emulate`


def test_a_drift_begins_at_once_and_ends() -> None:
    coil = energised(0.8)
    line = FaultyInstrument(emulate("scpi", coil), coil.clock)
    begin_fault(Fault.DRIFT, "scpi", coil, line)
    coil.clock.sleep(1.0)
    assert coil.coil_current_A() == pytest.approx(1.8)
    end_faults(coil, line)
    assert coil.coil_current_A() == pytest.approx(0.8)


def test_after_a_brownout_the_supply_does_not_answer_and_then_is_as_after_power_up() -> None:
    coil = energised()
    line = FaultyInstrument(emulate("scpi", coil), coil.clock)
    line.receive(b"NONSENSE\n")
    begin_fault(Fault.BROWNOUT, "scpi", coil, line)
    coil.clock.sleep(RESTARTS_WITHIN_S - 0.01)
    assert line.receive(b"OUTP?\n") == b""
    coil.clock.sleep(0.01)
    assert line.receive(b"OUTP?;CURR?;SYST:ERR?\n") == b'0;0.000000E+00;0,"No error"\n'


@pytest.mark.parametrize(
    ("driver", "question"), [("scpi", b"*IDN?\n"), ("genesys", b"ADR 6\rSN?\r"), ("korad", b"*IDN?")]
)
def test_another_unit_differs_only_in_its_serial_number(driver: str, question: bytes) -> None:
    clock = SimulatedClock()
    first, other = emulate(driver, CoilSupply(clock)).receive(question), another_unit(driver, clock).receive(question)
    if driver == "korad":
        assert first == other
        return
    assert OTHER_SERIAL_NUMBER.encode() in other
    separator = b"," if driver == "scpi" else b"\r"
    differing = [(a, b) for a, b in zip(first.split(separator), other.split(separator), strict=True) if a != b]
    assert [b for _, b in differing] == [OTHER_SERIAL_NUMBER.encode()]


def test_a_dialect_that_does_not_exist_is_refused_with_a_suggestion() -> None:
    with pytest.raises(InstrumentError, match=r"no emulated supply 'korat'; .*did you mean 'korad'"):
        emulate("korat", CoilSupply(SimulatedClock()))
