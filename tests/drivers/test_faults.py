"""With every fault of an emulated supply, no driver reports that the coil is off while a current flows."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from contextlib import closing, suppress

import pytest

from eimi_drivers.clock import SimulatedClock
from eimi_drivers.emulators import CoilSupply, emulate
from eimi_drivers.emulators.faults import LINE_FAULTS, SLEEPS_FOR_S, Fault, FaultyInstrument
from eimi_drivers.emulators.spoiling import begin_fault, end_faults
from eimi_drivers.interfaces import InstrumentDisconnected, InstrumentError, Limits, Off, SwitchOffFailed
from eimi_drivers.supplies import SUPPLIES, open_supply
from eimi_drivers.supplies.off import off_limit_A
from eimi_drivers.supplies.transport import InProcessTransport
from tests.patience import PATIENCE_S

LIMITS = Limits(current_A=1.0, voltage_V=12.0)
SWITCHED_OFF = {
    Fault.SLOW, Fault.DROP, Fault.DRIFT, Fault.FALLEN, Fault.OFFSET, Fault.HUNTING, Fault.TRIP, Fault.BROWNOUT
}  # fmt: skip
"""The faults with which a driver can switch the coil off and confirm that it is off."""


class ReopenedTransport(InProcessTransport):
    # A connection that, once cut, fails until the driver reopens it.

    def __init__(self, line: FaultyInstrument, clock: SimulatedClock) -> None:
        super().__init__(line, clock)
        self._line = line
        self._cut = False

    def write(self, message: bytes) -> None:
        if self._cut:
            raise InstrumentDisconnected(f"{self.address}: the line was cut")
        try:
            super().write(message)
        except InstrumentDisconnected:
            self._cut = True
            raise

    def reopen(self) -> bool:
        if self._line.lost:
            raise InstrumentDisconnected(f"{self.address}: there is no such port")
        self._cut = False
        return True


class Bench:
    def __init__(self, driver: str) -> None:
        self.clock, self.driver = SimulatedClock(), driver
        self.coil = CoilSupply(self.clock)
        self.line = FaultyInstrument(emulate(driver, self.coil), self.clock)
        self.supply = SUPPLIES[driver](ReopenedTransport(self.line, self.clock), LIMITS, self.clock)
        self.supply.identify()
        self.supply.set_voltage(12.0)
        self.supply.set_current(0.7)
        self.supply.set_output(True)
        self.clock.sleep(1.0)

    def begin(self, fault: Fault) -> None:
        begin_fault(fault, self.driver, self.coil, self.line)
        self.clock.sleep(1.5)


@pytest.mark.parametrize("fault", Fault, ids=lambda fault: fault.word)
@pytest.mark.parametrize("driver", ["korad", "scpi", "genesys", "kepco-bop", "keysight-n6700"])
def test_a_coil_is_reported_as_off_only_if_no_current_flows(driver: str, fault: Fault) -> None:
    bench = Bench(driver)
    bench.begin(fault)
    try:
        off = bench.supply.safe_off()
    except SwitchOffFailed:
        assert fault not in SWITCHED_OFF
        return
    assert fault in SWITCHED_OFF
    assert isinstance(off, Off)
    assert abs(bench.coil.coil_current_A()) <= 2 * off_limit_A(bench.supply)


@pytest.mark.parametrize("driver", ["korad", "scpi", "keysight-n6700"])
def test_a_supply_that_slept_is_switched_off_when_it_answers_again(driver: str) -> None:
    bench = Bench(driver)
    bench.begin(Fault.SLEEP)
    with pytest.raises(SwitchOffFailed):
        bench.supply.safe_off()
    assert bench.coil.coil_current_A() > 0.6
    bench.clock.sleep(SLEEPS_FOR_S)
    off = bench.supply.safe_off()
    assert (off.current_A < 0.02, off.found_off) == (True, False)
    assert not bench.coil.state.output


def test_a_supply_that_wakes_while_it_is_switched_off_is_identified() -> None:
    bench = Bench("genesys")
    bench.begin(Fault.SLEEP)
    while bench.coil.state.output:  # repeat until the supply answers again
        with suppress(SwitchOffFailed):
            bench.supply.safe_off()
    assert bench.supply.safe_off().current_A < off_limit_A(bench.supply)


@pytest.mark.parametrize("driver", ["genesys", "scpi"])
def test_a_supply_that_is_not_identified_on_a_reopened_line_may_be_another(driver: str) -> None:
    bench = Bench(driver)
    identity = {"genesys": b"SN?", "scpi": b"*IDN?"}[driver]
    bench.begin(Fault.SWAP)
    answers = bench.line.receive
    bench.line.receive = lambda data: b"" if data.startswith(identity) else answers(data)  # type: ignore[method-assign]
    for _ in range(2):
        with pytest.raises(SwitchOffFailed):
            bench.supply.safe_off()
    assert bench.coil.coil_current_A() == pytest.approx(0.7, abs=0.01)


@pytest.mark.parametrize("driver", ["scpi", "genesys", "keysight-n6700"])
def test_a_swapped_supply_is_named_and_left_alone(driver: str) -> None:
    bench = Bench(driver)
    bench.begin(Fault.SWAP)
    with pytest.raises(SwitchOffFailed, match=r"the coil's supply is not there: .*ANOTHER1"):
        bench.supply.safe_off()
    assert bench.coil.coil_current_A() == pytest.approx(0.7, abs=0.01)


@pytest.mark.parametrize("fault", [Fault.TRIP, Fault.BROWNOUT], ids=lambda fault: fault.word)
@pytest.mark.parametrize("driver", ["korad", "scpi", "genesys", "kepco-bop"])
def test_an_output_that_went_off_is_noticed(driver: str, fault: Fault) -> None:
    bench = Bench(driver)
    bench.begin(fault)
    if driver == "kepco-bop" and fault is Fault.BROWNOUT:  # its output is on after power-up, with a current of zero
        assert bench.supply.measure().current_A == pytest.approx(0.0, abs=0.01)
        return
    with pytest.raises(InstrumentError):
        bench.supply.check()


@pytest.mark.parametrize("fault", sorted(set(Fault) - {Fault.SWAP, Fault.TRIP, Fault.BROWNOUT}, key=lambda f: f.word),
                         ids=lambda fault: fault.word)  # fmt: skip
def test_after_the_end_of_a_fault_the_supply_works(fault: Fault) -> None:
    bench = Bench("scpi")
    bench.begin(fault)
    with suppress(InstrumentError):
        bench.supply.measure()
    end_faults(bench.coil, bench.line)
    bench.line.reconnect()
    bench.supply._link.reopen()
    bench.clock.sleep(2.0)
    assert bench.supply.measure().current_A == pytest.approx(0.7, abs=0.01)
    bench.supply.safe_off()


def test_a_fault_of_the_supply_is_no_fault_of_the_line() -> None:
    line = FaultyInstrument(emulate("scpi", CoilSupply(SimulatedClock())))
    assert Fault.SHORTED not in LINE_FAULTS
    with pytest.raises(ValueError, match="shorted is not a fault of the line"):
        line.inject(Fault.SHORTED)


def eimi_emulate(*arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-u", "-m", "eimi_lab", "emulate", *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def line_with(emulator: subprocess.Popen[str], pattern: str) -> str:
    # Read output up to the first line that matches `pattern`; return the first group of the match.
    assert emulator.stdout is not None
    for text in emulator.stdout:
        if match := re.search(pattern, text):
            return match[1]
    raise AssertionError(f"{pattern} was not printed")


@pytest.mark.timeout(PATIENCE_S)
@pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")
@pytest.mark.parametrize("arguments", [("scpi",), ("scpi", "--tcp", "0")], ids=["serial", "tcp"])
def test_a_supply_that_returns_at_another_address_can_only_be_switched_off_there(arguments: tuple[str, ...]) -> None:
    emulator = eimi_emulate(*arguments, "--fault", "reenumerate", "--after", "0")
    try:
        address = line_with(emulator, r'address = "(.*)"')
        with closing(open_supply("scpi", address, LIMITS)) as supply:
            supply.identify()
            supply.set_voltage(12.0)
            supply.set_current(0.5)
            with suppress(InstrumentError):  # the fault may begin before the output is verified
                supply.set_output(True)
            assert line_with(emulator, "the fault (reenumerate) begins")
            with pytest.raises(SwitchOffFailed):
                supply.safe_off()
        other = line_with(emulator, r'address = "(.*)"')
        assert other != address
        with closing(open_supply("scpi", other, LIMITS)) as reopened:
            assert reopened.output_on()
            reopened.safe_off()
        assert line_with(emulator, r"(output off, 0\.000 A set)")
    finally:
        emulator.send_signal(signal.SIGINT)
        emulator.communicate(timeout=PATIENCE_S)
    assert emulator.returncode == 130


@pytest.mark.timeout(PATIENCE_S)
@pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")
def test_a_port_that_was_unplugged_can_be_reopened() -> None:
    emulator = eimi_emulate("scpi", "--fault", "drop", "--after", "0")
    try:
        address = line_with(emulator, r'address = "(.*)"')
        with closing(open_supply("scpi", address, LIMITS)) as supply:
            supply.identify()
            supply.set_voltage(12.0)
            supply.set_current(0.5)
            with suppress(InstrumentError):  # the fault may begin before the output is verified
                supply.set_output(True)
            assert line_with(emulator, "the fault (drop) begins")
            until = time.monotonic() + PATIENCE_S
            while True:  # the port exists again after a short time
                try:
                    off = supply.safe_off()
                    break
                except SwitchOffFailed:
                    assert time.monotonic() < until
        assert off.current_A < 0.02
    finally:
        emulator.send_signal(signal.SIGINT)
        emulator.communicate(timeout=PATIENCE_S)


def test_every_fault_is_in_the_help_and_is_described(capfd: pytest.CaptureFixture[str]) -> None:
    def eimi(*arguments: str) -> str:
        command = [sys.executable, "-m", "eimi_lab", "emulate", *arguments]
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
        assert done.returncode == 0, done.stderr
        return " ".join(done.stdout.split())

    listed = eimi("--help").replace(" or ", ", ")
    described = eimi("--faults")
    for fault in Fault:
        assert re.search(rf"\b{fault.word}\b", listed)
        assert f"{fault.word}: {fault.effect}. A correct program {fault.correct}." in described
