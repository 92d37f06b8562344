"""Opening a supply by the name of its driver."""

from __future__ import annotations

from pathlib import Path

from eimi_drivers.clock import WallClock
from eimi_drivers.installed import Drivers
from eimi_drivers.interfaces import Clock, InstrumentError, Limits, PowerSupply
from eimi_drivers.supplies.base import SupplyBase
from eimi_drivers.supplies.genesys import GenesysSupply
from eimi_drivers.supplies.kepco import KepcoBopSupply
from eimi_drivers.supplies.korad import KoradSupply
from eimi_drivers.supplies.scpi import scpi_driver
from eimi_drivers.supplies.scpi_profiles import PROFILES
from eimi_drivers.supplies.transcript import RecordingTransport

_OWN: tuple[type[SupplyBase], ...] = (
    KoradSupply,
    *(scpi_driver(profile) for profile in PROFILES),
    GenesysSupply,
    KepcoBopSupply,
)

SUPPLIES: Drivers[type[SupplyBase]] = Drivers(
    "supply", "eimi_drivers.supplies", {driver.name: driver for driver in _OWN}
)
"""Every supply driver by its name, those of other installed packages included."""


def supply_driver(driver: str) -> type[SupplyBase]:
    """The driver class of that name. Raises InstrumentError naming those that exist."""
    return SUPPLIES.find(driver)


def open_supply(
    driver: str, address: str, limits: Limits, clock: Clock | None = None, transcript: Path | None = None
) -> PowerSupply:
    """Open the supply at an address. Nothing is sent: a supply that is on stays on.

    driver: a name in `SUPPLIES`. address: a serial port or a VISA resource, as the driver takes it; `#2` at
    its end names the channel.
    limits: the largest current (A) and voltage (V) that it may ever be asked for.
    clock: the wall clock unless given. transcript: a new file for every exchange, see `transcript`.

    Raises InstrumentError for an unknown driver or channel, InstrumentDisconnected when the address cannot be
    opened.
    """
    chosen = supply_driver(driver)
    link = chosen.connect(address)
    time = clock or WallClock()
    try:
        if transcript is not None:
            link = RecordingTransport(link, transcript, time)
        return chosen(link, limits, time)
    except (InstrumentError, OSError):
        link.close()
        raise
