"""The search lists instruments that announce themselves on the network, with addresses and drivers."""

from __future__ import annotations

import asyncio
import os
import socket
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import pytest
from zeroconf import EventLoopBlocked, ServiceInfo, Zeroconf

from eimi_drivers import lan_instruments
from eimi_drivers.emulators import DIALECTS
from eimi_drivers.lan_instruments import HISLIP, LXI, RAW, VXI_11, LanInstrument, _by_host, list_lan_instruments
from eimi_drivers.supplies.recognised import recognise
from tests.patience import PATIENCE_S

LOOPBACK = ["127.0.0.1"]
Search = Callable[[], tuple[LanInstrument, ...]]


def announced(kind: str, host: str, port: int, name: str, **fields: str) -> ServiceInfo:
    addresses = [socket.inet_aton(host)]
    return ServiceInfo(kind, f"{name}.{kind}", addresses=addresses, port=port, properties=fields, server="i.local.")


# The name contains the number of this process, so that it differs from the names that other test processes announce.
TTI = announced(
    LXI,
    "127.0.0.1",
    80,
    f"t521236-{os.getpid()}",
    Manufacturer="THURLBY THANDAR",
    Model="CPX400DP",
    SerialNumber="521236",
)


async def search_in_a_cell() -> tuple[LanInstrument, ...]:
    # Search in a thread with a running event loop, as in a notebook.
    return list_lan_instruments(interfaces=LOOPBACK)


def announce_and_list(search: Search, deadline: float) -> tuple[LanInstrument, ...]:
    # Announce an Aim-TTi supply on the loopback interface, and search until an instrument is listed.
    # deadline : end of the search (s, clock of `time.monotonic`)
    with Zeroconf(interfaces=LOOPBACK) as network:
        network.register_service(TTI, allow_name_change=True)
        instruments = search()
        while not instruments and time.monotonic() < deadline:
            instruments = search()
        network.unregister_all_services()
    return instruments


@pytest.mark.parametrize(
    "search",
    [
        pytest.param(lambda: list_lan_instruments(interfaces=LOOPBACK), id="program"),
        pytest.param(lambda: asyncio.run(search_in_a_cell()), id="notebook"),
    ],
)
def test_an_instrument_on_the_network_is_listed_with_its_driver(search: Search) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while True:
        try:
            # Tests with a browser leave a running event loop in this thread; zeroconf must not announce through it.
            with ThreadPoolExecutor(1) as thread:
                instruments = thread.submit(announce_and_list, search, deadline).result()
            break
        except EventLoopBlocked:  # zeroconf waits at most 10 s for its thread, which a busy computer can delay
            if time.monotonic() > deadline:
                raise
    instrument = next(each for each in instruments if "521236" in each.text)
    assert instrument.address == "TCPIP::127.0.0.1::9221::SOCKET"
    assert instrument.recognised is not None
    assert instrument.recognised.driver == "aim-tti"
    assert instrument.text == "THURLBY THANDAR CPX400DP, serial number 521236"


@pytest.mark.parametrize(("answers_after_s", "found"), [(0.5, True), (2.0, True), (3.0, False)])
def test_a_search_waits_for_slow_instruments_but_not_long(
    monkeypatch: pytest.MonkeyPatch, answers_after_s: float, found: bool
) -> None:
    info = announced(RAW, "192.0.2.9", 5025, "scope")
    told: list[Callable[..., None]] = []

    class Network(nullcontext["Network"]):
        def __init__(self, **options: Any) -> None:
            super().__init__(self)

        def get_service_info(self, kind: str, name: str, timeout: int) -> ServiceInfo:
            assert timeout == 500  # ms for each instrument
            return info

    class Browser:
        def __init__(self, network: Network, kinds: list[str], handlers: list[Callable[..., None]]) -> None:
            assert isinstance(network, Network)
            assert sorted(kinds) == sorted([RAW, HISLIP, VXI_11, LXI])
            told.extend(handlers)

        def cancel(self) -> None:
            told.clear()

    def sleep(seconds: float) -> None:
        if answers_after_s < seconds:
            for handler in told:
                handler(None, RAW, info.name, None)

    monkeypatch.setattr(lan_instruments, "Zeroconf", Network)
    monkeypatch.setattr(lan_instruments, "ServiceBrowser", Browser)
    monkeypatch.setattr(lan_instruments, "time", SimpleNamespace(sleep=sleep))
    assert [instrument.text for instrument in list_lan_instruments()] == ["scope"] * found


@pytest.mark.parametrize(
    ("services", "address"),
    [
        ([(LXI, 80), (RAW, 5025), (HISLIP, 4880)], "TCPIP::192.0.2.9::5025::SOCKET"),
        ([(HISLIP, 4880), (VXI_11, 111)], "TCPIP::192.0.2.9::hislip0::INSTR"),
        ([(VXI_11, 111)], "TCPIP::192.0.2.9::INSTR"),
        ([(LXI, 80)], ""),
    ],
)
def test_the_best_interface_of_an_unknown_instrument_is_its_address(
    services: list[tuple[str, int]], address: str
) -> None:
    infos = [announced(kind, "192.0.2.9", port, "scope") for kind, port in services]
    (instrument,) = _by_host(infos)
    assert (instrument.address, instrument.text, instrument.recognised) == (address, "scope", None)


@pytest.mark.parametrize("driver", [driver for driver in DIALECTS if driver != "scpi"])
def test_every_family_is_recognised_by_its_identification(driver: str) -> None:
    identification = DIALECTS[driver].identification  # type: ignore[attr-defined]
    text = identification.decode() if isinstance(identification, bytes) else identification
    recognised = recognise(text)
    assert recognised is not None
    assert recognised.driver == driver


@pytest.mark.parametrize("text", ["EIMI,EMULATED SUPPLY,0,1.0", "KEYSIGHT TECHNOLOGIES,DSOX1204G", "", "2260"])
def test_another_instrument_is_not_recognised(text: str) -> None:
    assert recognise(text) is None
