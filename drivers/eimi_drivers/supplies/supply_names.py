"""Open a supply by the name of its driver."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any, TypeVar

from eimi_drivers.clock import WallClock
from eimi_drivers.contract import check_supply, check_supply_driver
from eimi_drivers.installed import Drivers
from eimi_drivers.interfaces import (
    Clock,
    InstrumentError,
    Limits,
    PowerSupply,
    SupplyDriver,
    UnusableDriver,
    raised,
)
from eimi_drivers.supplies.aim_tti import AimTtiSupply
from eimi_drivers.supplies.base import SupplyBase
from eimi_drivers.supplies.foreign import ForeignSupply, Interruptions
from eimi_drivers.supplies.genesys import GenesysSupply
from eimi_drivers.supplies.interruptible import InterruptibleTransport
from eimi_drivers.supplies.kepco import KepcoBit4886Supply, KepcoBopSupply
from eimi_drivers.supplies.korad import KoradSupply
from eimi_drivers.supplies.logged import LoggedTransport, is_logged
from eimi_drivers.supplies.owon import OwonSpeSupply
from eimi_drivers.supplies.scpi import scpi_driver
from eimi_drivers.supplies.scpi_profiles import PROFILES
from eimi_drivers.supplies.transcript import RecordingTransport
from eimi_drivers.supplies.xln import XlnSupply

_Opened = TypeVar("_Opened")

_OWN: tuple[type[SupplyBase], ...] = (
    KoradSupply,
    *(scpi_driver(profile) for profile in PROFILES),
    GenesysSupply,
    KepcoBopSupply,
    KepcoBit4886Supply,
    AimTtiSupply,
    XlnSupply,
    OwonSpeSupply,
)

SUPPLIES: Drivers[SupplyDriver] = Drivers(
    "supply", "eimi_drivers.supplies", {driver.name: driver for driver in _OWN}, reserved=("virtual",)
)
"""Supply drivers by name: drivers of this package, of other installed packages, and drivers added by a program."""


def supply_driver(driver: str) -> SupplyDriver:
    """Return the supply driver with this name, after a check of its members that needs no instrument.

    Parameters
    ----------
    driver : str
        A name in `SUPPLIES`.

    Returns
    -------
    SupplyDriver
        The driver.

    Raises
    ------
    UnknownDriver
        No driver has this name.
    UnusableDriver
        The driver cannot be imported, cannot be called as `SupplyDriver` requires, or lacks a member of `PowerSupply`.
    """
    chosen = SUPPLIES[driver]
    check_supply_driver(driver, chosen)
    return chosen


def is_bipolar(driver: str) -> bool:
    """Return whether the supplies of the driver with this name can set negative currents.

    Raises UnknownDriver if no driver has this name, and UnusableDriver if the driver cannot be imported or lacks a
    member.
    """
    return bool(getattr(supply_driver(driver), "bipolar", False))


def open_supply(
    driver: str,
    address: str,
    limits: Limits,
    clock: Clock | None = None,
    transcript: Path | None = None,
    between_messages: Callable[[], None] | None = None,
) -> PowerSupply:
    """Open the supply at an address without sending a message. An output that is on therefore stays on.

    Parameters
    ----------
    driver : str
        A name in `SUPPLIES`.
    address : str
        A serial port or a VISA resource, in the form that the driver expects; ``#2`` at its end selects channel 2.
    limits : Limits
        The largest permitted current (A) and voltage (V).
    clock : Clock, optional
        The clock for all waits; the default is real time (the wall clock).
    transcript : Path, optional
        A new text file in which every message is recorded with its time. None for no file.
    between_messages : callable, optional
        A function that is called before each message if the driver has the member `connect`. The function may raise an
        error in order to interrupt a call of the supply before the next message. If the driver has no `connect`,
        no call is interrupted.

    Returns
    -------
    PowerSupply
        The open supply with every required member of `PowerSupply`. Every error that another package's driver raises in
        a call is raised as an InstrumentError.

    Raises
    ------
    UnusableDriver
        The driver is unknown or lacks a member, or a transcript is requested and the driver has no `connect`.
    InstrumentError
        The address contains a channel number that supplies of this family do not have.
    InstrumentDisconnected
        The address cannot be opened.
    """
    chosen = supply_driver(driver)
    interruptions = Interruptions(between_messages) if between_messages is not None else None
    supply = open_with(chosen, driver, address, limits, clock or WallClock(), transcript, interruptions)
    return supply if chosen in _OWN else ForeignSupply(supply, driver, address, interruptions)


def open_with(
    driver: SupplyDriver,
    name: str,
    address: str,
    limits: Limits,
    clock: Clock,
    transcript: Path | None = None,
    between_messages: Callable[[], None] | None = None,
) -> PowerSupply:
    """Open a supply with a driver that is given as an object, and return the supply. No message is sent.

    The driver need not be in `SUPPLIES`.

    Parameters
    ----------
    driver : SupplyDriver
        The class or the function that opens the supply.
    name : str
        The name of the driver in messages.
    address : str
        A serial port or a VISA resource, in the form that the driver expects.
    limits : Limits
        The largest permitted current (A) and voltage (V).
    clock : Clock
        The clock for all waits: real or simulated time.
    transcript : Path, optional
        A new file that records every message.
    between_messages : callable, optional
        A function that is called before each message if the driver has the member `connect`. The function may raise an
        error in order to interrupt a call of the supply.

    Raises
    ------
    UnusableDriver
        The driver or the supply lacks a member, or a transcript is requested and the driver has no `connect`.
    InstrumentError
        The address cannot be opened, or contains a channel number that supplies of this family do not have.
    """
    check_supply_driver(name, driver)
    connect = getattr(driver, "connect", None)
    if connect is None and transcript is not None:
        raise UnusableDriver(f"the supply driver {name!r} has no connect(address), so no transcript can be written")
    with ExitStack() as opened:
        link: Any = address
        if connect is not None:
            link = _opened(name, address, lambda: connect(address))
            if transcript is not None:
                opened.callback(link.close)
                link = RecordingTransport(link, transcript, clock)
            if is_logged():
                link = LoggedTransport(link, clock)
            if between_messages is not None:
                link = InterruptibleTransport(link, between_messages)
            opened.callback(link.close)
        supply = _opened(name, address, lambda: driver(link, limits, clock))
        check_supply(name, driver, supply)
        opened.pop_all()
    return supply


def _opened(name: str, address: str, open_it: Callable[[], _Opened]) -> _Opened:
    """Call `open_it`, which opens a connection or a supply, and return what it opens.

    An error of `open_it` is raised as an InstrumentError whose message contains `name` and `address`.
    """
    try:
        return open_it()
    except InstrumentError:
        raise
    except Exception as error:
        raise InstrumentError(f"{name} supply {address}: its driver raised {raised(error)} on opening") from error
