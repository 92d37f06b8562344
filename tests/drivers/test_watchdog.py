"""A supply with a watchdog of its own: armed, verified, held off by talking, and off where nobody talks any more."""

from __future__ import annotations

from typing import Any

import pytest

from eimi_drivers.emulators.faults import Fault
from eimi_drivers.interfaces import ProtectionTripped, SetPointNotTaken
from eimi_drivers.supplies import SUPPLIES

N6700 = "keysight-n6700 in process"


def test_it_switches_off_when_nobody_talks_any_more(bench_of: Any) -> None:
    bench = bench_of(N6700)
    bench.energise()
    for _ in range(10):
        bench.clock.sleep(4.0)
        bench.supply.check()
    assert bench.coil.coil_current_A() == pytest.approx(0.7, abs=0.01)
    bench.clock.sleep(11.0)  # a pulled cable
    bench.line.instrument.watch()
    assert not bench.coil.state.output
    with pytest.raises(ProtectionTripped, match="watchdog"):
        bench.supply.check()


def test_one_that_does_not_take_leaves_the_output_off(bench_of: Any) -> None:
    bench = bench_of(N6700)
    bench.line.inject(Fault.SILENCE, lambda message: message == b"OUTP:PROT:WDOG 1\n")
    with pytest.raises(SetPointNotTaken, match=r"watchdog of 10 s did not take: OUTP:PROT:WDOG\? is answered 0"):
        bench.energise()
    assert not bench.coil.state.output


def test_it_is_disarmed_with_the_output_off(bench_of: Any) -> None:
    bench = bench_of(N6700)
    bench.energise()
    bench.supply.safe_off()
    assert bench.sent[-2:] == [b"OUTP:PROT:WDOG 0\n", b"SYST:ERR?\n"]


def test_what_it_switched_off_does_not_come_back_with_the_next_run(bench_of: Any) -> None:
    bench = bench_of(N6700)
    bench.energise(0.7)
    bench.clock.sleep(11.0)
    bench.line.instrument.watch()
    assert bench.supply.output_on()  # as the manual has it: the programmed state is not changed
    bench.supply.safe_off()
    assert not bench.supply.output_on()
    currents: list[float] = []
    switch = bench.coil.switch
    bench.coil.switch = lambda on: (currents.append(bench.coil.state.set_current_A if on else 0.0), switch(on))[1]  # type: ignore[method-assign]
    bench.energise(0.2)
    assert max(currents) == pytest.approx(0.2)
    assert bench.coil.state.output


@pytest.mark.parametrize("driver", SUPPLIES)
def test_every_driver_says_what_a_pulled_cable_does(driver: str) -> None:
    words = SUPPLIES[driver].without_contact
    assert ("watchdog switches every output off" in words) == (driver == "keysight-n6700")
    assert ("stays as it was set" in words) == (driver != "keysight-n6700")
