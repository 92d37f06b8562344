"""If the measured current of a run departs from its set-point, the run ends with the coil off."""

from __future__ import annotations

from typing import Any

import pytest

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators.serve import open_in_process
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.interfaces import InstrumentError, Limits, SwitchOffFailed
from eimi_lab.acquisition.coil import Coil
from eimi_lab.acquisition.event_words import in_words
from eimi_lab.acquisition.events import Event, OffConfirmed, OffNotConfirmed
from eimi_lab.config.protocol import Protocol
from eimi_lab.config.toml import parse
from tests.lab.conftest import BEGAN_S

WITHIN_S = 3.0
"""Longest time from the fault until the output is off, s of simulated time."""


def restless(setup: Any) -> None:
    # Change a bench: the beam never comes to rest, and the protocol waits a minute for rest.
    text = setup.protocol.text.replace("timeout_s = 5.0", "timeout_s = 60.0")
    setup.protocol = parse(Protocol, text, "patient")
    setup.camera.sway_px = 0.5


def spoil_at(setup: Any, current_A: float, fault: Any) -> list[float]:
    # Let a fault occur at the set-point `current_A`; return the times (s) of the fault and of switching off.
    times_s: list[float] = []
    switch = setup.coil.switch

    def watch_output(on: bool) -> bool:
        if not on and times_s and setup.coil.state.output:
            times_s.append(setup.bench.clock.now())
        return bool(switch(on))

    def bring_about(number: int) -> None:
        if setup.coil.state.set_current_A == current_A and not times_s:
            fault()
            times_s.append(setup.bench.clock.now())

    setup.coil.switch = watch_output
    setup.camera.event = bring_about
    return times_s


@pytest.mark.parametrize("fault", ["drift", "fallen"])
def test_a_current_that_departs_while_the_beam_settles_ends_the_run(setup: Any, fault: str) -> None:
    restless(setup)

    def spoil() -> None:
        if fault == "drift":
            setup.coil.drift(2.4)
        else:
            setup.coil.fallen = True

    times_s = spoil_at(setup, 0.2, spoil)
    events: list[Event] = []
    with pytest.raises(InstrumentError, match=r"A measured at a set-point of 0\.2 A"):
        setup.run(remark=lambda words: None, on_event=events.append)
    began_s, off_s = times_s
    assert off_s - began_s < WITHIN_S
    assert not setup.coil.state.output
    assert any(isinstance(event, OffConfirmed) and event.determined_by == "measured" for event in events)


def test_a_shorted_regulator_at_the_end_of_a_protocol_is_reported_as_possibly_on(setup: Any) -> None:
    def short(number: int) -> None:
        if setup.coil.state.set_current_A == 0.3:
            setup.coil.shorted_A = 0.3

    setup.camera.event = short
    events: list[Event] = []
    with pytest.raises(SwitchOffFailed) as caught:
        setup.run(remark=lambda words: None, on_event=events.append)
    assert caught.value.current_A == pytest.approx(0.3, abs=0.01)
    assert not setup.coil.state.output
    assert not any(isinstance(event, OffConfirmed) for event in events)
    not_confirmed = next(event for event in events if isinstance(event, OffNotConfirmed))
    assert in_words(not_confirmed).startswith("THE COIL MAY STILL BE ON: 0.300 A measured, switch it off by hand")


def test_a_run_does_not_begin_while_a_current_flows_with_the_output_off(setup: Any) -> None:
    setup.coil.shorted_A = 0.8
    with pytest.raises(SwitchOffFailed, match=r"0\.800 A measured although the output is off"):
        setup.run(remark=lambda words: None)
    assert not setup.path.exists()


def test_a_single_wrong_measurement_does_not_end_a_run(setup: Any) -> None:
    measure = setup.bench.supply.measure
    wrong: list[float] = []

    def once() -> Any:
        reading = measure()
        if setup.coil.state.set_current_A == 0.2 and not wrong and setup.bench.clock.now() > BEGAN_S + 3.0:
            wrong.append(1.0)
            return type(reading)(reading.current_A + 1.0, reading.voltage_V)
        return reading

    restless(setup)
    setup.bench.supply.measure = once
    setup.protocol = parse(Protocol, setup.protocol.text.replace("timeout_s = 60.0", "timeout_s = 8.0"), "p")
    setup.run(remark=lambda words: None)
    assert wrong
    assert setup.stored() == [0.0, 0.1, 0.2, 0.3]


def test_after_a_wrong_current_in_a_state_no_ramp_precedes_the_switching_off(setup: Any) -> None:
    clock = SimulatedClock()
    supply = CoilSupply(clock)
    coil = Coil(open_in_process("scpi", supply, Limits(1.0, 10.0)), clock, setup.protocol.ramp)
    coil.supply.set_voltage(10.0)
    coil.supply.set_output(True)
    coil.step_to(0.5)
    coil.wait_until_reached()
    supply.fallen = True
    with pytest.raises(InstrumentError, match=r"0\.000 A measured at a set-point of 0\.5 A"):
        coil.measured_A()
    coil.ramp_down()
    assert supply.state.set_current_A == 0.5
    coil.switch_off()
    assert not supply.state.output


def coil_with_current(setup: Any, exchange_s: float = 0.0) -> tuple[CoilSupply, Coil]:
    # Return an emulated supply at 0.5 A, and the coil of a run on this supply.
    # exchange_s: time (s) that each set-point takes.
    clock = SimulatedClock()
    supply = CoilSupply(clock)
    coil = Coil(open_in_process("scpi", supply, Limits(1.0, 10.0)), clock, setup.protocol.ramp)
    coil.supply.set_voltage(10.0)
    coil.supply.set_output(True)
    set_current = coil.supply.set_current

    def read_back_late(current_A: float) -> None:
        set_current(current_A)
        clock.sleep(exchange_s)

    coil.supply.set_current = read_back_late  # type: ignore[method-assign]
    coil.step_to(0.5)
    return supply, coil


def slow_ramp(setup: Any) -> None:
    text = setup.protocol.text.replace("rate_A_per_s = 10.0", "rate_A_per_s = 0.05")
    setup.protocol = parse(Protocol, text.replace("step_A = 0.1\ntol", "step_A = 0.02\ndown_within_s = 2.0\ntol"), "p")


@pytest.mark.parametrize(("late_s", "least_s", "most_s"), [(0.0, 1.9, 2.01), (1.5, 0.4, 0.51), (5.0, 0.0, 0.0)])
def test_the_time_since_a_signal_counts_as_a_part_of_the_ramp_down(
    setup: Any, late_s: float, least_s: float, most_s: float
) -> None:
    slow_ramp(setup)
    supply, coil = coil_with_current(setup)
    coil.count_the_end(late_s)
    began_s = supply.clock.now()
    coil.ramp_down()
    assert least_s <= supply.clock.now() - began_s <= most_s
    assert (supply.state.set_current_A == 0.0) == (late_s < 2.0)


@pytest.mark.parametrize("exchange_s", [0.3, 0.7, 1.0, 1.9, 3.0])
def test_the_ramp_down_does_not_begin_a_step_that_would_end_too_late(setup: Any, exchange_s: float) -> None:
    slow_ramp(setup)
    supply, coil = coil_with_current(setup, exchange_s)
    began_s = supply.clock.now()
    coil.ramp_down()
    assert supply.clock.now() - began_s <= 2.01
    assert supply.state.set_current_A < 0.5 or exchange_s > 2.0
