"""List the instruments that announce themselves on the local network by multicast DNS.

Source: LXI Device Specification, section 10.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

from zeroconf import InterfaceChoice, IPVersion, ServiceBrowser, ServiceInfo, ServiceStateChange, Zeroconf

from eimi_drivers.supplies.recognised import Recognised, recognise

SEARCH_S = 2.5
"""Time (s) for which the search waits for the answers of the instruments on the network."""

RAW, HISLIP, VXI_11, LXI = "_scpi-raw._tcp.local.", "_hislip._tcp.local.", "_vxi-11._tcp.local.", "_lxi._tcp.local."


@dataclass(frozen=True)
class LanInstrument:
    """An instrument that announced itself on the local network.

    Parameters
    ----------
    host : str
        IPv4 address of the instrument.
    address : str
        VISA resource of the instrument; empty if not known.
    text : str
        Maker, model and serial number, as far as they are announced.
    recognised : Recognised or None
        Driver for this maker and model; None if no driver fits.
    """

    host: str
    address: str
    text: str
    recognised: Recognised | None


@dataclass
class _Announced:
    """The announcements of one host: the port of each kind of service, and the fields of the TXT records."""

    ports: dict[str, int] = field(default_factory=dict)
    fields: dict[str, str] = field(default_factory=dict)
    name: str = ""


def list_lan_instruments(
    search_s: float = SEARCH_S, interfaces: Sequence[str] | InterfaceChoice = InterfaceChoice.Default
) -> tuple[LanInstrument, ...]:
    """Return the instruments that announce themselves on the network during the search.

    Parameters
    ----------
    search_s : float
        Duration of the search, s.
    interfaces : sequence of str or InterfaceChoice
        Addresses of this computer's network interfaces that are searched.

    Returns
    -------
    tuple of LanInstrument
        Instruments, sorted by `host`.

    Raises
    ------
    OSError
        The network cannot be used.
    """
    # In a notebook the main thread has an event loop. zeroconf would use this loop and wait forever.
    with ThreadPoolExecutor(1, "search of the network") as thread:
        return _by_host(thread.submit(_announced_services, search_s, interfaces).result())


def _announced_services(search_s: float, interfaces: Sequence[str] | InterfaceChoice) -> list[ServiceInfo]:
    """Return the services that instruments announce within `search_s` (s)."""
    services: dict[tuple[str, str], None] = {}

    def note(zeroconf: Zeroconf, service_type: str, name: str, state_change: ServiceStateChange) -> None:
        services[service_type, name] = None

    with Zeroconf(interfaces=interfaces, ip_version=IPVersion.V4Only) as network:
        browser = ServiceBrowser(network, [RAW, HISLIP, VXI_11, LXI], handlers=[note])
        time.sleep(search_s)
        browser.cancel()
        infos = [network.get_service_info(kind, name, timeout=500) for kind, name in list(services)]
    return [info for info in infos if info is not None]


def _by_host(infos: Sequence[ServiceInfo]) -> tuple[LanInstrument, ...]:
    hosts: dict[str, _Announced] = {}
    for info in infos:
        for host in info.parsed_addresses(IPVersion.V4Only):
            announced = hosts.setdefault(host, _Announced())
            announced.ports[info.type] = info.port or 0
            announced.fields |= {key: value for key, value in info.decoded_properties.items() if value}
            announced.name = announced.name or info.name.removesuffix("." + info.type)
    return tuple(_instrument(host, hosts[host]) for host in sorted(hosts, key=_numbers))


def _numbers(host: str) -> tuple[int, ...]:
    return tuple(int(part) for part in host.split("."))


def _instrument(host: str, announced: _Announced) -> LanInstrument:
    fields = announced.fields
    text = " ".join(fields[key] for key in ("Manufacturer", "Model") if key in fields) or announced.name
    recognised = recognise(f"{text} {announced.name}")
    if serial_number := fields.get("SerialNumber"):
        text = f"{text}, serial number {serial_number}"
    return LanInstrument(host, _address(host, announced.ports, recognised), text, recognised)


def _address(host: str, ports: dict[str, int], recognised: Recognised | None) -> str:
    """Return the VISA resource of the instrument at `host`; empty if no port is known."""
    # a TCP socket is preferred, then HiSLIP, then VXI-11
    if port := ports.get(RAW) or (recognised.port if recognised else 0):
        return f"TCPIP::{host}::{port}::SOCKET"
    if HISLIP in ports:
        return f"TCPIP::{host}::hislip0::INSTR"
    return f"TCPIP::{host}::INSTR" if VXI_11 in ports else ""
