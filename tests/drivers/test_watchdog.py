"""The driver starts and verifies the watchdog of a supply, which switches the output off if no messages arrive."""

from __future__ import annotations

from typing import Any

import pytest

from eimi_drivers.emulators.faults import Fault
from eimi_drivers.interfaces import ProtectionTripped, SetPointNotTaken
from eimi_drivers.supplies import SUPPLIES

N6700 = "keysight-n6700 in process"
WATCHED = ("keysight-n6700", "keysight-n6900", "keysight-rp7900", "delta-sm15k", "delta-psc-eth")
"""The families of supplies with a watchdog."""


def test_the_watchdog_switches_off_after_messages_have_stopped(bench_of: Any) -> None:
    bench = bench_of(N6700)
    bench.energise()
    for _ in range(10):
        bench.clock.sleep(4.0)
        bench.supply.check()
    assert bench.coil.coil_current_A() == pytest.approx(0.7, abs=0.01)
    bench.clock.sleep(11.0)  # the cable is pulled
    bench.line.instrument.watch()
    assert not bench.coil.state.output
    with pytest.raises(ProtectionTripped, match="watchdog"):
        bench.supply.check()


def test_the_output_stays_off_if_the_watchdog_does_not_start(bench_of: Any) -> None:
    bench = bench_of(N6700)
    bench.line.inject(Fault.SILENCE, lambda message: message == b"OUTP:PROT:WDOG 1\n")
    with pytest.raises(SetPointNotTaken, match=r"was not set to 10 s: the answer to OUTP:PROT:WDOG\? is 0"):
        bench.energise()
    assert not bench.coil.state.output


def test_the_watchdog_is_stopped_after_switching_off(bench_of: Any) -> None:
    bench = bench_of(N6700)
    bench.energise()
    bench.supply.safe_off()
    assert bench.sent[-2:] == [b"OUTP:PROT:WDOG 0\n", b"SYST:ERR?\n"]


def test_the_earlier_current_does_not_return_when_the_watchdog_is_cleared(bench_of: Any) -> None:
    bench = bench_of(N6700)
    bench.energise(0.7)
    bench.clock.sleep(11.0)
    bench.line.instrument.watch()
    assert bench.supply.output_on()  # according to the manual, the watchdog does not change the programmed state
    bench.supply.safe_off()
    assert not bench.supply.output_on()
    currents: list[float] = []
    switch = bench.coil.switch
    bench.coil.switch = lambda on: (currents.append(bench.coil.state.set_current_A if on else 0.0), switch(on))[1]  # type: ignore[method-assign]
    bench.energise(0.2)
    assert max(currents) == pytest.approx(0.2)
    assert bench.coil.state.output


@pytest.mark.parametrize("driver", SUPPLIES)
def test_every_driver_says_what_happens_after_a_cable_is_pulled(driver: str) -> None:
    words = SUPPLIES[driver].without_contact
    assert ("watchdog switches every output off 10 s after" in words) == (driver in WATCHED)
    assert ("timer switches the output off 14400 s after" in words) == (driver == "keithley-2200")
    assert ("stays as it was set" in words) == (driver not in {*WATCHED, "keithley-2200"})


@pytest.mark.parametrize("driver", WATCHED)
def test_every_watchdog_switches_off_and_is_reported_as_a_trip(bench_of: Any, driver: str) -> None:
    bench = bench_of(f"{driver} in process")
    bench.energise()
    bench.clock.sleep(9.0)
    bench.supply.check()
    bench.clock.sleep(11.0)
    bench.line.instrument.watch()
    assert not bench.coil.state.output
    with pytest.raises(ProtectionTripped, match="watchdog"):
        bench.supply.check()
    bench.supply.safe_off()
    assert not bench.line.instrument.watchdog.on


@pytest.mark.parametrize("driver", WATCHED)
def test_no_watchdog_expires_between_two_messages_of_a_run(bench_of: Any, driver: str) -> None:
    bench = bench_of(f"{driver} in process")
    bench.energise()
    for _ in range(20):
        bench.clock.sleep(2.0)
        bench.supply.measure()
    bench.supply.check()
    assert bench.coil.state.output


def test_the_output_timer_of_a_2200_counts_from_switching_on(bench_of: Any) -> None:
    bench = bench_of("keithley-2200 in process")
    bench.energise()
    bench.clock.sleep(14000.0)
    bench.supply.check()
    bench.clock.sleep(500.0)
    with pytest.raises(ProtectionTripped):
        bench.supply.check()
    assert not bench.coil.state.output
    bench.supply.safe_off()
    assert not bench.line.instrument.timer.on


@pytest.mark.parametrize(
    ("driver", "lost"),
    [
        ("keithley-2200", b"OUTP:TIM 1\n"),
        ("delta-sm15k", b"SYSTEM:COMMUNICATE:WATCHDOG SET,10000\n"),
        ("keysight-n6900", b"OUTP:PROT:WDOG:DEL 10\n"),
    ],
)
def test_the_output_stays_off_if_a_timer_is_not_set(bench_of: Any, driver: str, lost: bytes) -> None:
    bench = bench_of(f"{driver} in process")
    bench.line.inject(Fault.SILENCE, lambda message: message == lost)
    with pytest.raises(SetPointNotTaken, match="was not set"):
        bench.energise()
    assert not bench.coil.state.output
