"""The bench: an ordinary driver on an emulated supply, over every transport that the drivers have."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import pytest

from eimi_drivers.clock import SimulatedClock, WallClock
from eimi_drivers.emulators import DIALECTS, CoilSupply, emulate, serve_pty, serve_tcp
from eimi_drivers.emulators.faults import FaultyInstrument
from eimi_drivers.interfaces import Clock, Limits, PowerSupply
from eimi_drivers.supplies import SUPPLIES, open_supply
from eimi_drivers.supplies.transport import InProcessTransport

LIMITS = Limits(current_A=1.0, voltage_V=12.0)
IN_PROCESS = tuple(f"{driver} in process" for driver in DIALECTS)
QUICK_LINKS = ("korad on a pty", "genesys on a pty", "scpi over tcp")
SERIAL_DRIVERS = ("korad", "genesys")


def links(quick: tuple[str, ...]) -> list[object]:
    """Every driver over every transport; those on real ports that are not in `quick` in the slow run alone."""
    real = [f"{driver} {where}" for driver in DIALECTS for where in ("on a pty", "over tcp")]
    slow = (pytest.param(link, marks=pytest.mark.slow) for link in real if link not in quick)
    return [*IN_PROCESS, *quick, *slow]


@dataclass
class Bench:
    supply: PowerSupply
    coil: CoilSupply
    line: FaultyInstrument
    clock: Clock
    driver: str
    address: str
    sent: list[bytes]

    def energise(self, current_A: float = 0.7) -> None:
        self.supply.set_voltage(12.0)
        self.supply.set_current(current_A)
        self.supply.set_output(True)
        self.clock.sleep(0.2)  # 20 time constants of the coil

    def energised(self) -> bool:
        """Whether current flows, whatever the driver says; off is a current of zero on some supplies."""
        return self.coil.state.output and self.coil.state.set_current_A != 0.0


@contextmanager
def open_bench(link: str) -> Iterator[Bench]:
    driver, _, where = link.partition(" ")
    clock: Clock = SimulatedClock() if where == "in process" else WallClock()
    coil = CoilSupply(clock, resistance_ohm=4.0, time_constant_s=0.01)
    line = FaultyInstrument(emulate(driver, coil), clock)
    with ExitStack() as stack:
        sent: list[bytes] = []
        if where == "in process":
            address = "in-process"
            transport = InProcessTransport(line, clock, address)
            sent = transport.sent
            supply: PowerSupply = SUPPLIES[driver](transport, LIMITS, clock)
        else:
            address = stack.enter_context(serve_tcp(line) if where == "over tcp" else serve_pty(line))
            if where == "on a pty" and driver not in SERIAL_DRIVERS:
                address = f"ASRL{address}::INSTR"
            if where == "over tcp" and driver in SERIAL_DRIVERS:
                address = f"socket://127.0.0.1:{address.split('::')[2]}"
            supply = open_supply(driver, address, LIMITS)
        stack.callback(supply.close)
        yield Bench(supply, coil, line, clock, driver, address, sent)


@pytest.fixture(params=links(QUICK_LINKS[-1:]))
def waiting_bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    """As `bench`, for what takes seconds of waiting on a real port."""
    with open_bench(request.param) as opened:
        yield opened


@pytest.fixture(params=links(QUICK_LINKS))
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    """A driver over each transport."""
    with open_bench(request.param) as opened:
        yield opened


@pytest.fixture(params=IN_PROCESS)
def quick_bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    """Each driver on an emulator in the same process, in simulated time."""
    with open_bench(request.param) as opened:
        yield opened


@pytest.fixture
def bench_of() -> Iterator[Callable[[str], Bench]]:
    """Opens the bench of one driver and transport by its name."""
    with ExitStack() as stack:
        yield lambda link: stack.enter_context(open_bench(link))


@pytest.fixture
def korad() -> Iterator[Bench]:
    with open_bench("korad in process") as opened:
        yield opened


@pytest.fixture
def scpi() -> Iterator[Bench]:
    with open_bench("scpi in process") as opened:
        yield opened
