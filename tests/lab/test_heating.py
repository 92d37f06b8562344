"""The computed heating of the coil agrees with the solution of its differential equation."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eimi_lab.acquisition import heating
from eimi_lab.acquisition.coil import REACHED_WITHIN_S
from eimi_lab.acquisition.heating import FRAME_WITHIN_S, STORED_WITHIN_S, Warming, hottest, refuse_overheating
from eimi_lab.config.protocol import Conditioning, Currents, Protocol, Ramp, RingDown, Settle, SupplyLimits
from eimi_lab.config.rig import CoilRating
from eimi_lab.process.errors import InputError


def protocol(currents_A: list[float], timeout_s: float = 30.0) -> Protocol:
    return Protocol(
        name="p",
        material="m",
        frames_per_state=2,
        current=Currents(values_A=tuple(currents_A)),
        ramp=Ramp(rate_A_per_s=1000.0, step_A=0.1, tolerance_A=0.02),
        limits=SupplyLimits(current_A=10.0, voltage_V=30.0),
        settle=Settle(noise_ratio=1.2, pairs=2, drift_window_s=1.0, timeout_s=timeout_s),
    )


def test_a_constant_current_warms_the_coil_exponentially() -> None:
    rating = CoilRating(continuous_current_A=1.0, thermal_time_constant_s=100.0)
    held_s = 30.0 + REACHED_WITHIN_S + 2 * FRAME_WITHIN_S + 12 * STORED_WITHIN_S
    assert held_s == pytest.approx(30.0 + 3.0 + 2 * 0.5 + 12 * 0.1)  # of the state, its current, frames and transient
    hottest_part = hottest(protocol([0.0, 2.0]), rating)
    assert hottest_part.stage == "state 1 (2 A)"
    assert hottest_part.share == pytest.approx(4 * (1 - math.exp(-held_s / 100.0)), rel=1e-3)


@pytest.mark.parametrize(("dwell_s", "rest_s"), [(20.0, 30.0 + REACHED_WITHIN_S), (600.0, 600.0)])
def test_a_dwell_longer_than_the_wait_for_the_beam_warms_the_coil(dwell_s: float, rest_s: float) -> None:
    # With a time constant much longer than the run, the heat is the integral of the squared current.
    rating = CoilRating(continuous_current_A=1.0, thermal_time_constant_s=1e7)
    usual = protocol([0.0, 2.0], timeout_s=30.0)
    long = usual.model_copy(update={"settle": usual.settle.model_copy(update={"dwell_s": dwell_s})})
    held_s = rest_s + 2 * FRAME_WITHIN_S + 12 * STORED_WITHIN_S
    assert hottest(long, rating).share == pytest.approx(4.0 * held_s / 1e7, rel=1e-3)


@pytest.mark.parametrize("cycles", [1, 2, 4])
def test_the_heat_includes_the_frames_in_the_first_and_in_the_last_conditioning_cycle(cycles: int) -> None:
    # With a time constant much longer than the run, the heat is the integral of the squared current.
    rating = CoilRating(continuous_current_A=1.0, thermal_time_constant_s=1e7)
    rule = Conditioning(cycles=cycles, current_A=2.0)
    hottest_part = hottest(protocol([0.0, 0.0], timeout_s=30.0).model_copy(update={"conditioning": rule}), rating)
    recorded_s, other_s = 30.0 + REACHED_WITHIN_S + FRAME_WITHIN_S, REACHED_WITHIN_S
    held_s = min(cycles, 2) * recorded_s + max(0, cycles - 2) * other_s
    assert hottest_part.share == pytest.approx(4.0 * held_s / 1e7, rel=1e-3)


def test_the_current_before_each_ring_down_warms_the_coil() -> None:
    rating = CoilRating(continuous_current_A=1.0, thermal_time_constant_s=1e7)
    rule = RingDown(seconds=20.0, repeats=3, from_A=2.0)
    worst = hottest(protocol([0.0, 0.0]).model_copy(update={"ring_down": rule}), rating)
    assert worst.stage == "ring-down 2 (from 2 A)"
    assert worst.share == pytest.approx(4.0 * 3 * (30.0 + REACHED_WITHIN_S) / 1e7, rel=1e-3)
    with pytest.raises(
        InputError, match=r"at ring-down 0 \(from 2 A\).*reduce the currents, settle.timeout_s, settle.dwell_s, or"
    ):
        refuse_overheating(
            protocol([0.0, 0.0]).model_copy(update={"ring_down": RingDown(seconds=20.0, repeats=1, from_A=2.0)}),
            CoilRating(continuous_current_A=1.0, thermal_time_constant_s=60.0),
        )


def test_the_heat_of_a_ramp_is_the_integral_of_the_squared_current() -> None:
    rating = CoilRating(continuous_current_A=1.0, thermal_time_constant_s=1e7)
    slow = protocol([1.0, 3.0]).model_copy(update={"ramp": Ramp(rate_A_per_s=0.01, step_A=0.1, tolerance_A=0.02)})
    ramp_A2s = sum((0.01 * second) ** 2 for second in range(300))  # a sweep from 0 to 3 A at 10 mA/s
    held_A2s = (1.0 + 9.0) * (30.0 + REACHED_WITHIN_S + 2 * FRAME_WITHIN_S + 12 * STORED_WITHIN_S)
    assert hottest(slow, rating).share == pytest.approx((ramp_A2s + held_A2s) / 1e7, rel=0.005)


def test_a_coil_cools_after_the_peak_of_a_sweep() -> None:
    rating = CoilRating(continuous_current_A=1.0, thermal_time_constant_s=10.0)
    assert hottest(protocol([0.0, 0.5, 1.5, 0.5, 0.0]), rating).stage == "state 2 (1.5 A)"


@given(st.lists(st.floats(-3.0, 3.0), min_size=2, max_size=20), st.floats(1.0, 1e4))
def test_smoothed_heat_never_exceeds_the_largest_current_squared(currents_A: list[float], tau_s: float) -> None:
    rating = CoilRating(continuous_current_A=1.0, thermal_time_constant_s=tau_s)
    share = hottest(protocol(currents_A), rating).share
    assert 0.0 <= share <= max(current**2 for current in currents_A) * (1 + 1e-12)


def test_a_current_within_the_continuous_rating_is_never_refused() -> None:
    refuse_overheating(protocol([1.0] * 500), CoilRating(continuous_current_A=1.0000001, thermal_time_constant_s=60.0))
    with pytest.raises(InputError, match=r"overheat the coil at state \d+ \(1 A\).*continuous_current_A = 0\.9"):
        refuse_overheating(protocol([1.0] * 500), CoilRating(continuous_current_A=0.9, thermal_time_constant_s=60.0))


def test_a_protocol_without_current_is_hottest_at_the_beginning() -> None:
    hottest_part = hottest(protocol([0.0, 0.0]), CoilRating(continuous_current_A=1.0, thermal_time_constant_s=10.0))
    assert (hottest_part.stage, hottest_part.share) == ("the beginning", 0.0)


def test_the_heat_of_a_run_follows_the_current_that_flows() -> None:
    # The heat h solves τ dh/dt = I² − h; I is the current, τ the thermal time constant of the coil, and h (A²) the
    # square of the constant current that would warm the coil as much.
    warming = Warming(CoilRating(continuous_current_A=2.0, thermal_time_constant_s=100.0))
    assert warming.share(5.0) == 0.0
    warming.flows(1000.0, 3.0)
    assert warming.share(1000.0) == 0.0
    after_50_s = 9.0 * (1 - math.exp(-0.5))
    assert warming.share(1050.0) == pytest.approx(after_50_s / 4.0)
    warming.flows(1050.0, 1.0)
    assert warming.share(1050.0) == pytest.approx(after_50_s / 4.0)
    after_80_s = 1.0 + (after_50_s - 1.0) * math.exp(-0.3)
    assert warming.share(1080.0) == pytest.approx(after_80_s / 4.0)
    warming.flows(1080.0, 0.0)
    assert warming.share(1180.0) == pytest.approx(after_80_s * math.exp(-1.0) / 4.0)
    assert warming.share(1e6) == pytest.approx(0.0, abs=1e-12)


def test_just_the_allowed_heat_is_permitted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(heating, "hottest", lambda protocol, rating: heating.Heating("state 1 (1 A)", 1.0))
    rating = CoilRating(continuous_current_A=1.0, thermal_time_constant_s=60.0)
    refuse_overheating(protocol([0.0, 1.0]), rating)
    monkeypatch.setattr(heating, "hottest", lambda protocol, rating: heating.Heating("state 1 (1 A)", 1.26))
    with pytest.raises(InputError, match=r"protocol p: could overheat the coil at state 1 \(1 A\): 126 % of the heat"):
        refuse_overheating(protocol([0.0, 1.0]), rating)
