"""Fixtures that connect supply drivers to emulated supplies; a link is a text such as "korad over tcp"."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from functools import partial

import pytest

from eimi_drivers.emulators import DIALECTS, emulate, serve_pty, serve_tcp
from eimi_drivers.supplies import SUPPLIES
from eimi_drivers.supplies.transport import Responder
from eimi_drivers.testing import SupplyBench, check_supply, supply_bench
from eimi_drivers.testing.claims import Check

IN_PROCESS = tuple(f"{driver} in process" for driver in DIALECTS)
QUICK_LINKS = ("korad on a pty", "genesys on a pty", "scpi over tcp")
SERIAL_DRIVERS = ("korad", "genesys")


def links(quick: tuple[str, ...]) -> list[object]:
    # Return the links of all drivers (texts such as "korad over tcp") as parameters of a test. Tests with a link "...
    # in process" or a link in `quick` always run; those with another link are marked slow.
    real = [f"{driver} {where}" for driver in DIALECTS for where in ("on a pty", "over tcp")]
    slow = (pytest.param(link, marks=pytest.mark.slow) for link in real if link not in quick)
    return [*IN_PROCESS, *quick, *slow]


def served(link: str) -> Callable[[Responder], AbstractContextManager[str]] | None:
    # Return a function that serves an emulated supply and yields its address; None if driver and supply are connected
    # inside the process, without an address.
    driver, _, where = link.partition(" ")

    @contextmanager
    def serve(line: Responder) -> Iterator[str]:
        with (serve_tcp if where == "over tcp" else serve_pty)(line) as address:
            if where == "on a pty" and driver not in SERIAL_DRIVERS:
                address = f"ASRL{address}::INSTR"
            if where == "over tcp" and driver in SERIAL_DRIVERS:
                address = f"socket://127.0.0.1:{address.split('::')[2]}"
            yield address

    return None if where == "in process" else serve


def open_bench(link: str) -> AbstractContextManager[SupplyBench]:
    driver = link.partition(" ")[0]
    return supply_bench(SUPPLIES[driver], partial(emulate, driver), served(link))


@pytest.fixture
def conforms() -> Callable[[str, Check[SupplyBench]], None]:
    # Return a function that runs one check on the driver of a link such as "korad over tcp".
    def run(link: str, check: Check[SupplyBench]) -> None:
        driver = link.partition(" ")[0]
        # A busy computer may be slow. The limit of 5 s is therefore checked in simulated time only.
        patience_s = 5.0 if link in IN_PROCESS else 60.0
        emulator = partial(emulate, driver)
        check_supply(SUPPLIES[driver], emulator, serve=served(link), answer_within_s=patience_s, checks=[check])

    return run


@pytest.fixture(params=links(QUICK_LINKS))
def link(request: pytest.FixtureRequest) -> str:
    # Each driver with each connection to its emulated supply, as text such as "korad over tcp".
    return str(request.param)


@pytest.fixture(params=links(QUICK_LINKS[-1:]))
def waiting_link(request: pytest.FixtureRequest) -> str:
    # A driver with its connection, such as "korad over tcp", for checks that wait for seconds.
    return str(request.param)


@pytest.fixture
def waiting_bench(waiting_link: str) -> Iterator[SupplyBench]:
    # An open supply driver and its emulated supply, for checks that wait for seconds.
    with open_bench(waiting_link) as opened:
        yield opened


@pytest.fixture
def bench(link: str) -> Iterator[SupplyBench]:
    # An open supply driver and its emulated supply, connected as `link` says.
    with open_bench(link) as opened:
        yield opened


@pytest.fixture(params=IN_PROCESS)
def quick_bench(request: pytest.FixtureRequest) -> Iterator[SupplyBench]:
    # Each supply driver, open, with its emulated supply in the same process and in simulated time.
    with open_bench(request.param) as opened:
        yield opened


@pytest.fixture
def bench_of() -> Iterator[Callable[[str], SupplyBench]]:
    # Return a function that opens the driver and the emulated supply of a link such as "korad over tcp".
    with ExitStack() as stack:
        yield lambda link: stack.enter_context(open_bench(link))


@pytest.fixture
def korad() -> Iterator[SupplyBench]:
    with open_bench("korad in process") as opened:
        yield opened


@pytest.fixture
def scpi() -> Iterator[SupplyBench]:
    with open_bench("scpi in process") as opened:
        yield opened
