"""The current of a coil follows its ramps, and a wrong current is noticed at the right time."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.interfaces import Identity, InstrumentError, InstrumentTimeout, Limits, Reading
from eimi_lab.acquisition import coil as coil_module
from eimi_lab.acquisition.coil import Coil, without_contact
from eimi_lab.acquisition.interlocks import BeyondInterlock, Interlocks
from eimi_lab.config.interlock import Interlock
from eimi_lab.config.protocol import Ramp
from tests.shared.noted import Noted, noted

RULE = Ramp(rate_A_per_s=0.5, step_A=0.1, tolerance_A=0.02, down_within_s=2.0)


class Supply:
    # A replacement for a supply in simulated time.
    # exchange_s: duration (s) of each exchange that sends a set-point. meter: function from set-point (A) and time (s)
    # to the measured current (A).

    limits = Limits(2.0, 10.0)
    without_contact = "it stays on"

    def __init__(self) -> None:
        self.clock = SimulatedClock(100.0)
        self.exchange_s = 0.0
        self.set_A = 0.0
        self.sent: list[tuple[float, float]] = []
        self.measured_s: list[float] = []
        self.checked_s: list[float] = []
        self.meter: Callable[[float, float], float] = lambda set_A, now_s: set_A
        self.fault: Exception | None = None

    def identify(self) -> Identity:
        return Identity("s", "a supply", "COM3")

    def set_current(self, current_A: float) -> None:
        self.sent.append((round(self.clock.now() - 100.0, 6), current_A))
        self.clock.sleep(self.exchange_s)
        self.set_A = current_A

    def measure(self) -> Reading:
        self.measured_s.append(round(self.clock.now() - 100.0, 6))
        return Reading(self.meter(self.set_A, self.clock.now() - 100.0), 4.0)

    def check(self) -> None:
        self.checked_s.append(round(self.clock.now() - 100.0, 6))
        if self.fault:
            raise self.fault


def coil_on(supply: Supply, **options: Any) -> Coil:
    return Coil(supply, supply.clock, RULE, **options)  # type: ignore[arg-type]


def test_a_ramp_has_equal_steps_at_equal_times_and_ends_at_the_current() -> None:
    supply = Supply()
    coil = coil_on(supply)
    coil.ramp_to(0.25)
    assert supply.sent == [(0.0, 0.083333), (0.2, 0.166667), (0.4, 0.25)]
    assert supply.clock.now() == pytest.approx(100.6)
    coil.ramp_to(-0.05)
    assert [current_A for _, current_A in supply.sent[3:]] == [0.15, 0.05, -0.05]
    coil.ramp_to(-0.05)
    assert len(supply.sent) == 6
    assert coil.asked_A == -0.05


def test_a_ramp_leaves_out_the_time_that_the_supply_takes_and_can_be_stopped_while_it_waits() -> None:
    supply = Supply()
    supply.exchange_s = 0.15
    asked: list[float] = []
    coil_on(supply).ramp_to(0.3, lambda: asked.append(supply.clock.now() - 100.0))
    assert [at_s for at_s, _ in supply.sent] == pytest.approx([0.0, 0.2, 0.4])
    supply.exchange_s = 0.0
    coil = coil_on(supply)
    coil._pause(0.35, lambda: asked.append(supply.clock.now()))
    assert len(asked) == 3 + 3 * 2 + 17  # each step, and each full 0.02 s of the pauses of 0.05 s and 0.35 s


def test_set_points_have_the_middle_of_their_exchange_as_time_and_its_length_as_uncertainty() -> None:
    supply = Supply()
    supply.exchange_s = 0.12
    coil = coil_on(supply)
    coil.ramp_to(0.2)
    points = coil.new_set_points()
    assert [(point.time_s - 100.0, point.current_A) for point in points] == [
        (pytest.approx(0.06), 0.1),
        (pytest.approx(0.26), 0.2),
    ]
    assert points[0].uncertainty_s == pytest.approx(0.12 / math.sqrt(12))  # of a uniform distribution
    assert coil.new_set_points() == []
    assert coil.changed_s == pytest.approx(100.32)


def test_a_step_is_measured_until_the_current_follows() -> None:
    supply = Supply()
    supply.exchange_s = 0.06
    coil = coil_on(supply, asked_A=0.5)
    supply.meter = lambda set_A, now_s: 0.5 if now_s < 0.2 else set_A
    step = coil.step_to(0.0)
    assert supply.measured_s == pytest.approx([0.06, 0.16, 0.26])
    assert (step.time_s, step.current_A) == (pytest.approx(100.03), 0.0)
    assert step.uncertainty_s == pytest.approx(math.hypot(0.06, 0.2) / math.sqrt(12))
    coil.watch()
    assert supply.measured_s[-1] == pytest.approx(0.26)  # the step has just measured


def test_a_current_that_is_not_reached_within_3_s_is_an_error() -> None:
    supply = Supply()
    coil = coil_on(supply)
    coil._set(0.5)
    supply.meter = lambda set_A, now_s: 0.45
    with pytest.raises(
        InstrumentError, match=r"COM3: 0\.450 A measured at a set-point of 0\.5 A; .*tolerance_A = 0\.02"
    ):
        coil.wait_until_reached()
    assert 3.0 < supply.clock.now() - 100.0 < 3.2
    assert coil.out_of_control
    assert len(supply.checked_s) == len(supply.measured_s)


@pytest.mark.parametrize(("measured_A", "is_right"), [(0.52, True), (0.48, True), (0.521, False), (0.479, False)])
def test_the_measured_current_may_differ_by_the_tolerance(measured_A: float, is_right: bool) -> None:
    supply = Supply()
    coil = coil_on(supply)
    coil._set(0.5)
    supply.meter = lambda set_A, now_s: measured_A + 1e-12 * (0.5 - measured_A)
    if is_right:
        assert coil.measured_A() == pytest.approx(measured_A)
    else:
        with pytest.raises(InstrumentError, match="measured at a set-point"):
            coil.measured_A()
    assert coil.out_of_control is not is_right


def test_swapped_leads_change_the_sign_of_every_current() -> None:
    supply = Supply()
    coil = coil_on(supply)
    coil.leads_swapped = True
    coil.ramp_to(-0.2)
    assert [current_A for _, current_A in supply.sent] == [0.1, 0.2]
    assert coil.measured_A() == -0.2
    coil.ramp_to(0.0)
    assert math.copysign(1.0, supply.sent[-1][1]) == 1.0
    assert math.copysign(1.0, coil.measured_A()) == 1.0


def watched(supply: Supply, coil: Coil, seconds: float, **options: Any) -> list[float]:
    # Let a run watch its coil for some seconds; return the times (s) at which the current was measured.
    supply.measured_s.clear()
    supply.checked_s.clear()
    for _ in range(round(seconds / 0.1)):
        coil.watch(**options)
        supply.clock.sleep(0.1)
    return supply.measured_s


def test_a_real_supply_is_measured_every_1_5_s_and_sooner_on_request() -> None:
    supply = Supply()
    assert watched(supply, coil_on(supply), 5.0) == pytest.approx([1.6, 3.2, 4.8], abs=0.11)
    assert supply.checked_s == supply.measured_s
    supply = Supply()
    assert watched(supply, coil_on(supply), 5.0, early_s=0.5) == pytest.approx([1.1, 2.2, 3.3, 4.4], abs=0.11)


@pytest.mark.parametrize(("asked_A", "every_s"), [(0.5, 2.0), (0.0, 8.0)])
def test_a_simulated_supply_is_checked_and_not_measured(asked_A: float, every_s: float) -> None:
    supply = Supply()
    coil = coil_on(supply, asked_A=asked_A, simulated=True)
    assert watched(supply, coil, 2.5 * every_s) == []
    assert supply.checked_s == pytest.approx([every_s + 0.1, 2 * every_s + 0.2], abs=0.11)


def test_a_simulated_supply_with_an_interlock_is_measured() -> None:
    supply = Supply()
    rules = Interlocks([Interlock(reading="coil_voltage_V", maximum=5.0)])
    coil = coil_on(supply, simulated=True, interlocks=rules)
    assert watched(supply, coil, 2.0) == pytest.approx([1.6], abs=0.11)


def test_nothing_is_measured_while_another_thread_sets_a_current() -> None:
    supply = Supply()
    coil = coil_on(supply)
    with coil._stepping:
        assert watched(supply, coil, 3.0) == []
    assert len(watched(supply, coil, 0.1)) == 1
    assert not coil._stepping.locked()


def test_only_a_second_wrong_current_ends_a_run() -> None:
    supply = Supply()
    coil = coil_on(supply)
    supply.meter = lambda set_A, now_s: 0.05 if now_s < 1.7 else 0.0
    assert watched(supply, coil, 2.0) == pytest.approx([1.6, 1.8], abs=0.11)
    assert not coil.out_of_control
    supply.meter = lambda set_A, now_s: 0.05
    with pytest.raises(InstrumentError, match=r"0\.050 A measured at a set-point of 0 A"):
        watched(supply, coil, 2.0)
    assert coil.out_of_control


@pytest.mark.parametrize(
    ("age_s", "measured_A", "is_right"),
    [
        (0.1, 0.0, True),  # the meter may lag behind the set-point by 1.5 s
        (1.4, 0.0, True),
        (1.6, 0.0, False),
        (1.6, 0.5, True),
        (0.1, -0.021, False),
        (0.1, 0.521, False),
        (0.1, 0.25, True),
    ],
)
def test_the_current_may_lie_between_the_set_points_of_the_last_time(
    age_s: float, measured_A: float, is_right: bool
) -> None:
    supply = Supply()
    coil = coil_on(supply)
    supply.clock.sleep(5.0)
    coil._set(0.5)
    supply.clock.sleep(age_s)
    assert coil._is_right(measured_A) is is_right


@pytest.mark.parametrize(
    ("set_A", "measured_A", "is_right"), [(0.0, 0.05, True), (0.5, 0.55, False), (0.5, 0.515, True)]
)
def test_the_zero_error_of_a_meter_is_permitted_at_a_set_point_of_zero_only(
    set_A: float, measured_A: float, is_right: bool
) -> None:
    supply = Supply()
    supply.limits = Limits(2.0, 10.0, off_below_A=0.06)
    assert coil_on(supply, asked_A=set_A)._is_right(measured_A) is is_right


def test_a_current_above_the_limit_of_the_supply_is_wrong() -> None:
    supply = Supply()
    coil = coil_on(supply, asked_A=2.0)
    assert coil._is_right(2.02)
    coil = coil_on(supply, asked_A=2.1)
    assert not coil._is_right(2.1)


def test_a_silent_supply_leaves_out_the_ramp_down() -> None:
    supply = Supply()
    coil = coil_on(supply, asked_A=0.5)
    supply.fault = InstrumentTimeout("nothing came")
    with pytest.raises(InstrumentTimeout):
        coil.check()
    assert coil.unreachable == "nothing came"
    coil.ramp_down()
    assert supply.sent == []


def test_an_open_interlock_leaves_out_the_ramp_down() -> None:
    supply = Supply()
    rules = Interlocks([Interlock(reading="air", maximum=30.0, longest_silence_s=2.0)])
    values = {"air": 31.0}
    coil = coil_on(supply, interlocks=rules, sense=lambda: values)
    with pytest.raises(BeyondInterlock, match="31 measured, above maximum = 30"):
        watched(supply, coil, 2.0)
    assert coil.out_of_control
    values["air"] = 29.0
    coil = coil_on(supply, interlocks=rules, sense=lambda: values)
    watched(supply, coil, 2.0)
    values.clear()
    with pytest.raises(BeyondInterlock, match=r"no reading for 2\.\d s"):
        watched(supply, coil, 4.0)
    assert coil.out_of_control
    coil.ramp_down()
    assert supply.sent == []


@pytest.mark.parametrize(
    ("from_A", "exchange_s", "began_ago_s", "lasts_s"),
    [
        (0.5, 0.0, None, 1.0),  # 0.5 A at 0.5 A/s
        (-0.5, 0.0, None, 1.0),
        (2.0, 0.0, None, 2.0),  # the time of the protocol, and not 4 s
        (2.0, 0.0, 0.5, 1.5),  # a signal came half a second ago
        (2.0, 0.3, None, 2.0),
    ],
)
def test_the_current_goes_to_zero_within_its_time(
    from_A: float, exchange_s: float, began_ago_s: float | None, lasts_s: float
) -> None:
    supply = Supply()
    coil = coil_on(supply, asked_A=from_A)
    supply.exchange_s = exchange_s
    if began_ago_s is not None:
        coil.count_the_end(began_ago_s)
        coil.count_the_end()  # only the first call counts
    coil.ramp_down()
    shares = [current_A / from_A for _, current_A in supply.sent]
    assert all(later < earlier for earlier, later in zip([1.0, *shares], shares, strict=False))
    assert shares[-1] >= 0.0
    for at_s, current_A in supply.sent:  # each set-point is that of the straight line at the end of its step
        step_s = max(lasts_s / math.ceil(abs(from_A) / 0.1), exchange_s if at_s else 0.0)
        assert current_A / from_A == pytest.approx(max(0.0, 1 - (at_s + step_s) / lasts_s), abs=1e-5)
    assert supply.clock.now() - 100.0 <= lasts_s + 1e-9
    if not exchange_s:
        assert coil.asked_A == 0.0
        assert supply.clock.now() - 100.0 == pytest.approx(lasts_s)


def test_the_words_without_contact_are_those_of_the_driver() -> None:
    assert without_contact(Supply()) == "it stays on"
    assert (
        without_contact(object())
        == "nobody knows what the output does, because the driver of the supply does not report it"
    )


@pytest.mark.parametrize(("measured_A", "is_right"), [(0.53125, True), (0.46875, True), (0.53126, False)])
def test_a_difference_equal_to_the_tolerance_is_permitted(measured_A: float, is_right: bool) -> None:
    supply = Supply()
    rule = RULE.model_copy(update={"tolerance_A": 0.03125})
    coil = Coil(supply, supply.clock, rule)  # type: ignore[arg-type]
    coil._set(0.5)
    supply.meter = lambda set_A, now_s: measured_A
    for act in (coil.wait_until_reached, coil.measured_A):
        if is_right:
            assert act() in (None, measured_A)
            assert not coil.out_of_control
        else:
            with pytest.raises(InstrumentError, match="measured at a set-point"):
                act()


def test_the_longest_of_the_last_three_exchanges_counts() -> None:
    supply = Supply()
    coil = coil_on(supply)
    for exchange_s in (0.5, 0.1, 0.2, 0.3, 0.25):
        supply.exchange_s = exchange_s
        coil._set(0.1)
    assert list(coil._took_s) == pytest.approx([0.2, 0.3, 0.25])


def test_after_the_output_was_off_the_silence_of_the_sensors_is_counted_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[Any] = []
    supply = Supply()
    coil = coil_on(supply, asked_A=0.5, interlocks=Noted(calls, "interlocks"))
    monkeypatch.setattr(coil_module, "switch_off", noted(calls, "off", "the output is off"))
    assert coil.switch_off() == "the output is off"  # type: ignore[comparison-overlap]
    assert calls == [("interlocks.restart",), ("off", supply, supply.clock)]
    assert coil.asked_A == 0.0
    assert coil._is_right(0.25)  # between the set-points of the last 1.5 s
