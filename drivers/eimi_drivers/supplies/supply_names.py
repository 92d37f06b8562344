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
    """Return the supply driver with this name, after a check of its methods.

    Parameters
    ----------
    driver : str
        Name of the driver, such as "korad".

    Raises
    ------
    UnknownDriver
        No driver has this name.
    UnusableDriver
        The driver cannot be imported, has wrong arguments, or lacks a member of `PowerSupply`.
    """
    chosen = SUPPLIES[driver]
    check_supply_driver(driver, chosen)
    return chosen


def is_bipolar(driver: str) -> bool:
    """Return whether the supplies of a driver can set negative currents.

    Raises
    ------
    UnknownDriver
        No driver has this name.
    UnusableDriver
        The driver cannot be imported or lacks a member.
    """
    return bool(getattr(supply_driver(driver), "bipolar", False))


def current_step_A(driver: str) -> str | None:
    """Return the step in which the supplies of a driver set their current, A; None if the driver does not state it.

    Some drivers know a finer step only after they have identified the supply. The errors are those of `supply_driver`.
    """
    step = getattr(supply_driver(driver), "current_step_A", None)
    return str(step) if isinstance(step, str | float) else None


def open_supply(
    driver: str,
    address: str,
    limits: Limits,
    clock: Clock | None = None,
    transcript: Path | None = None,
    between_messages: Callable[[], None] | None = None,
) -> PowerSupply:
    """Open the supply at an address and return it. No message is sent.

    Parameters
    ----------
    driver : str
        Name of the driver, such as "korad".
    address : str
        Serial port or VISA resource; ``#2`` at its end selects channel 2.
    limits : Limits
        Largest permitted current (A) and voltage (V).
    clock : Clock, optional
        Clock for all waits; real time by default.
    transcript : Path, optional
        New text file in which every message is recorded.
    between_messages : callable, optional
        Function that is called before each message and may raise an error; not called if the driver has no `connect`.

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

    Parameters
    ----------
    driver : SupplyDriver
        Class or function that opens the supply.
    name : str
        Name of the driver, for messages.
    address : str
        Serial port or VISA resource.
    limits : Limits
        Largest permitted current (A) and voltage (V).
    clock : Clock
        Clock for all waits: real or simulated time.
    transcript : Path, optional
        New text file in which every message is recorded.
    between_messages : callable, optional
        Function that is called before each message and may raise an error; not called if the driver has no `connect`.

    Raises
    ------
    UnusableDriver
        The driver or the supply lacks a member, or a transcript is requested and the driver has no `connect`.
    InstrumentError
        The address cannot be opened, or contains a channel number that the supplies of this driver do not have.
    """
    check_supply_driver(name, driver)
    connect = getattr(driver, "connect", None)
    if connect is None and transcript is not None:
        raise UnusableDriver(
            f"the supply driver {name!r} has no function connect(address), so its messages cannot be recorded in a "
            "transcript"
        )
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
    """Return the result of `open_it`; raise its error as an InstrumentError with `name` and `address`."""
    try:
        return open_it()
    except InstrumentError:
        raise
    except Exception as error:
        raise InstrumentError(f"{name} supply {address}: its driver raised {raised(error)} on opening") from error
