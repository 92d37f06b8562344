"""A supply counts as off only if it measures no current, whatever state it reports."""

from __future__ import annotations

import pytest

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators.serve import DIALECTS, emulate, open_in_process
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import Limits, Off, SwitchOffFailed
from eimi_drivers.supplies.off import DECAYS_WITHIN_S, LEAST_OFF_A, off_limit_A, switch_off
from eimi_drivers.supplies.supply_names import supply_driver
from eimi_drivers.supplies.transport import InProcessTransport

LIMITS = Limits(1.0, 12.0)


@pytest.fixture
def coil():
    return CoilSupply(SimulatedClock(), resistance_ohm=4.0)


def energised(driver, coil, limits=LIMITS):
    supply = open_in_process(driver, coil, limits)
    supply.set_voltage(12.0)
    supply.set_current(0.8)
    supply.set_output(True)
    return supply


@pytest.mark.parametrize("driver", DIALECTS)
def test_a_supply_with_a_shorted_regulator_is_never_reported_as_off(driver, coil):
    supply = energised(driver, coil)
    coil.shorted_A = 0.8
    with pytest.raises(SwitchOffFailed, match=r"0\.800 A measured although the output was switched off") as caught:
        supply.safe_off()
    assert caught.value.current_A == pytest.approx(0.8, abs=0.01)
    assert caught.value.limit_A == off_limit_A(supply)
    assert coil.state.set_current_A == 0.0
    coil.shorted_A = 0.0
    assert supply.safe_off().current_A <= off_limit_A(supply)


@pytest.mark.parametrize("ends", [10, pytest.param(200, marks=pytest.mark.slow)])
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("driver", DIALECTS)
def test_a_healthy_supply_at_its_worst_offset_gives_no_false_alarm(driver, sign, ends, coil):
    supply = energised(driver, coil)
    coil.offset_A = sign * max(LEAST_OFF_A, supply.reads_zero_within_A) * 0.999
    false_alarms, largest_A = [], 0.0
    for _ in range(ends):
        supply.set_current(0.8)
        supply.set_output(True)
        coil.clock.sleep(1.0)
        try:
            off = supply.safe_off()
        except SwitchOffFailed as error:
            false_alarms.append(str(error))
            continue
        largest_A = max(largest_A, abs(off.current_A))
        # A meter that measures too little hides a current of the same size.
        assert abs(coil.coil_current_A()) <= 2 * off.limit_A
    print(
        f"{driver}: {ends} ends at an offset of {coil.offset_A:+.4f} A, limit {off_limit_A(supply):g} A: "
        f"{len(false_alarms)} false alarms, largest reading {largest_A:.4f} A"
    )
    assert false_alarms == []


def test_a_current_just_above_the_limit_is_written_with_three_digits(coil):
    supply = energised("scpi", coil)
    coil.offset_A = 0.0214
    with pytest.raises(SwitchOffFailed, match=r"0\.021 A measured although .* must be at most 0\.02 A$"):
        supply.safe_off()


def test_switching_off_waits_for_the_decay_of_a_slow_coil():
    coil = CoilSupply(SimulatedClock(), resistance_ohm=4.0, time_constant_s=0.3)
    supply = energised("scpi", coil)
    coil.clock.sleep(5.0)
    began_s = coil.clock.now()
    assert supply.safe_off() == Off(pytest.approx(0.0, abs=LEAST_OFF_A), LEAST_OFF_A)
    assert 0.3 < coil.clock.now() - began_s < DECAYS_WITHIN_S
    assert coil.coil_current_A() <= LEAST_OFF_A


def test_the_off_limit_in_the_rig_file_replaces_the_limit_of_the_family(coil):
    supply = energised("genesys", coil, Limits(1.0, 12.0, off_below_A=0.03))
    assert off_limit_A(supply) == 0.03
    coil.offset_A = 0.05
    with pytest.raises(SwitchOffFailed, match=r"must be at most 0\.03 A"):
        supply.safe_off()
    assert off_limit_A(open_in_process("genesys", coil, LIMITS)) == pytest.approx(
        0.15
    )  # 0.3 % of 50 A, the offset of a GEN30-50


def test_the_current_is_measured_if_the_safe_off_of_a_driver_does_not_measure_it(coil):
    supply = energised("scpi", coil)

    class Commanding:
        limits = LIMITS

        def safe_off(self):
            supply.safe_off()

        def measure(self):
            return supply.measure()

    assert switch_off(Commanding(), coil.clock) == Off(pytest.approx(0.0, abs=LEAST_OFF_A), LEAST_OFF_A)
    silent = Commanding()
    silent.measures_current = False
    assert switch_off(silent, coil.clock) is None


class Line(InProcessTransport):
    # A connection that leads to another instrument after it was reopened.

    def __init__(self, first, second, clock):
        super().__init__(first, clock)
        self._second = second

    def reopen(self):
        self._responder = self._second
        return True


class Cut:
    # An emulated instrument whose connection is cut if `cut` is True.

    cut = False

    def __init__(self, instrument):
        self.instrument = instrument

    def receive(self, data):
        if self.cut:
            raise ConnectionResetError("the line was cut")
        return self.instrument.receive(data)


def on_a_line_that_is_cut(first, second, coil):
    instrument = Cut(first)
    supply = supply_driver("scpi")(Line(instrument, second, coil.clock), LIMITS, coil.clock)
    supply.identify()
    supply.set_voltage(12.0)
    supply.set_current(0.8)
    supply.set_output(True)
    instrument.cut = True
    return supply


def scpi(coil, serial_number):
    dialect = emulate("scpi", coil)
    dialect.identification = f"EIMI,EMULATED SUPPLY,{serial_number},1.0"
    return dialect


def test_another_supply_at_the_same_address_is_reported_and_left_alone(coil):
    stranger = CoilSupply(coil.clock)
    stranger.switch(True)
    supply = on_a_line_that_is_cut(scpi(coil, "A1"), scpi(stranger, "B2"), coil)
    with pytest.raises(SwitchOffFailed, match=r"the coil's supply is not there: .*B2"):
        supply.safe_off()
    assert stranger.state.output
    assert coil.state.output


def test_the_same_supply_with_a_serial_number_may_be_found_off(coil):
    supply = on_a_line_that_is_cut(scpi(coil, "A1"), scpi(coil, "A1"), coil)
    coil.switch(False)  # a person pressed the output button
    off = supply.safe_off()
    assert off.found_off
    assert off.current_A <= LEAST_OFF_A


def test_a_supply_without_a_serial_number_that_is_found_off_may_be_another_one(coil):
    stranger = CoilSupply(coil.clock)
    supply = on_a_line_that_is_cut(scpi(coil, "0"), scpi(stranger, "0"), coil)
    with pytest.raises(SwitchOffFailed, match="has no serial number: it may be another supply"):
        supply.safe_off()


def test_a_supply_without_a_serial_number_that_is_found_on_is_switched_off(coil):
    supply = on_a_line_that_is_cut(scpi(coil, "0"), scpi(coil, "0"), coil)
    assert not supply.safe_off().found_off
    assert not coil.state.output
