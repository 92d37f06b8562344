"""Opening a supply by the name of its driver."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from eimi_drivers.clock import WallClock
from eimi_drivers.contract import check_supply, check_supply_driver
from eimi_drivers.installed import Drivers
from eimi_drivers.interfaces import Clock, Limits, PowerSupply, SupplyDriver, UnusableDriver
from eimi_drivers.supplies.base import SupplyBase
from eimi_drivers.supplies.genesys import GenesysSupply
from eimi_drivers.supplies.interruptible import InterruptibleTransport
from eimi_drivers.supplies.kepco import KepcoBopSupply
from eimi_drivers.supplies.korad import KoradSupply
from eimi_drivers.supplies.logged import LoggedTransport, is_logged
from eimi_drivers.supplies.scpi import scpi_driver
from eimi_drivers.supplies.scpi_profiles import PROFILES
from eimi_drivers.supplies.transcript import RecordingTransport

_OWN: tuple[type[SupplyBase], ...] = (
    KoradSupply,
    *(scpi_driver(profile) for profile in PROFILES),
    GenesysSupply,
    KepcoBopSupply,
)

SUPPLIES: Drivers[SupplyDriver] = Drivers(
    "supply", "eimi_drivers.supplies", {driver.name: driver for driver in _OWN}, reserved=("virtual",)
)
"""Every supply driver by name: those of this package, those of other installed packages, and those that are added."""


def supply_driver(driver: str) -> SupplyDriver:
    """Return the driver of that name, checked as far as it can be without an instrument.

    Raises
    ------
    UnknownDriver
        There is no driver of that name.
    UnusableDriver
        It cannot be imported, or lacks a member of `PowerSupply`.
    """
    chosen = SUPPLIES[driver]
    check_supply_driver(driver, chosen)
    return chosen


def is_bipolar(driver: str) -> bool:
    """Return whether the supplies of that driver can reverse their current. Raises as `supply_driver` does."""
    return bool(getattr(supply_driver(driver), "bipolar", False))


def open_supply(
    driver: str,
    address: str,
    limits: Limits,
    clock: Clock | None = None,
    transcript: Path | None = None,
    between_messages: Callable[[], None] | None = None,
) -> PowerSupply:
    """Open the supply at an address. Nothing is sent: a supply that is on stays on.

    Parameters
    ----------
    driver : str
        A name in `SUPPLIES`.
    address : str
        A serial port or a VISA resource, as the driver takes it; `#2` at its end names the channel.
    limits : Limits
        The largest current (A) and voltage (V) that the supply may ever be asked for.
    clock : Clock, optional
        The wall clock unless given.
    transcript : Path, optional
        A new file for every exchange, see `transcript`.
    between_messages : callable, optional
        Is called before each message to a supply whose driver has `connect`, and may raise, see
        `InterruptibleTransport`. A supply without `connect` is never interrupted within a call.

    Returns
    -------
    PowerSupply
        The open supply, which has every member of `PowerSupply`.

    Raises
    ------
    UnusableDriver
        The driver is unknown, lacks a member, or has no `connect` where a transcript is asked for.
    InstrumentError
        The address names a channel that there is not.
    InstrumentDisconnected
        The address cannot be opened.
    """
    return open_with(supply_driver(driver), driver, address, limits, clock or WallClock(), transcript, between_messages)


def open_with(
    driver: SupplyDriver,
    name: str,
    address: str,
    limits: Limits,
    clock: Clock,
    transcript: Path | None = None,
    between_messages: Callable[[], None] | None = None,
) -> PowerSupply:
    """Open a supply with a driver that needs no entry in `SUPPLIES`. See `open_supply`; `name` is for messages."""
    check_supply_driver(name, driver)
    connect = getattr(driver, "connect", None)
    if connect is None and transcript is not None:
        raise UnusableDriver(f"the supply driver {name!r} has no connect(address), so no transcript can be written")
    with ExitStack() as opened:
        link: Any = address
        if connect is not None:
            link = connect(address)
            if transcript is not None:
                opened.callback(link.close)
                link = RecordingTransport(link, transcript, clock)
            if is_logged():
                link = LoggedTransport(link, clock)
            if between_messages is not None:
                link = InterruptibleTransport(link, between_messages)
            opened.callback(link.close)
        supply = driver(link, limits, clock)
        check_supply(name, driver, supply)
        opened.pop_all()
    return supply
