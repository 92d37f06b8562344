"""A supply with its own watchdog: it is armed and verified, and switches off after the last message."""

from __future__ import annotations

from typing import Any

import pytest

from eimi_drivers.emulators.faults import Fault
from eimi_drivers.interfaces import ProtectionTripped, SetPointNotTaken
from eimi_drivers.supplies import SUPPLIES

N6700 = "keysight-n6700 in process"


def test_the_watchdog_switches_off_after_messages_have_stopped(bench_of: Any) -> None:
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


def test_the_output_stays_off_if_the_watchdog_does_not_start(bench_of: Any) -> None:
    bench = bench_of(N6700)
    bench.line.inject(Fault.SILENCE, lambda message: message == b"OUTP:PROT:WDOG 1\n")
    with pytest.raises(SetPointNotTaken, match=r"watchdog of 10 s was not set: OUTP:PROT:WDOG\? is answered 0"):
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
def test_every_driver_states_the_effect_of_a_pulled_cable(driver: str) -> None:
    words = SUPPLIES[driver].without_contact
    assert ("watchdog switches every output off" in words) == (driver == "keysight-n6700")
    assert ("stays as it was set" in words) == (driver != "keysight-n6700")
