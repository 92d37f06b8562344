"""What is attached, and the driver that would serve it. Nothing is opened: a supply may be in use."""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pyvisa
from serial.tools import list_ports

from eimi_drivers.cameras import CAMERAS
from eimi_drivers.supplies import SUPPLIES
from eimi_drivers.supplies.transport import visa_library

KORAD_USB_IDS = frozenset({(0x0416, 0x5011)})
"""Vendor and product of the USB serial chip in Korad, Tenma and RND supplies; some printers have it too."""

SERIAL_DRIVERS = "korad, genesys or one of the SCPI drivers"
SCPI_DRIVERS = "scpi or the family's own"


@dataclass(frozen=True)
class Found:
    """Something that a rig file could name.

    driver: the driver that would serve it; several, with "or", for a port that does not say what is behind it.
    address: what goes into the rig file as address (supply) or source (camera).
    text: what the operating system calls it.
    """

    kind: Literal["supply", "camera"]
    driver: str
    address: str
    text: str


@dataclass(frozen=True)
class Discovery:
    """found: what is attached. notes: what could not be searched, or opened, or found, and what to do."""

    found: tuple[Found, ...]
    notes: tuple[str, ...]


def discover() -> Discovery:
    """List serial ports, VISA resources and cameras. Takes a second, for answers from the LAN (VXI-11)."""
    ports = list_serial_ports()
    resources, notes = list_visa_resources()
    cameras = (*list_cameras(), *list_basler_cameras())
    return Discovery(
        found=(*ports, *resources, *cameras),
        notes=(
            *notes,
            *(_no_permission(found.address) for found in ports if _forbidden(found.address)),
            *((NO_SUPPLY,) if not (ports or resources) else ()),
            *(() if cameras else (NO_CAMERA if VIDEO_DEVICES.is_dir() else UNLISTED_CAMERAS,)),
            *_drivers_from_elsewhere(),
        ),
    )


NO_SUPPLY = (
    "supplies: none found. Is it switched on, its cable in? A supply that answers raw sockets on the LAN only is not "
    "found: give its address, TCPIP::host::5025::SOCKET"
)
NO_CAMERA = "cameras: none found. Is its cable in? Basler cameras need the extra: pip install 'eimi-lab[basler]'"
UNLISTED_CAMERAS = "cameras: this system lists none; try the indices 0, 1, 2 as the camera's source"


def _forbidden(port: str) -> bool:
    return os.path.exists(port) and not os.access(port, os.R_OK | os.W_OK)


def _no_permission(port: str) -> str:
    return f"{port}: this user may not open it; on Linux, join the group that owns it (dialout or uucp), then log in"


def _drivers_from_elsewhere() -> tuple[str, ...]:
    return tuple(
        f"{kind} drivers {origin}: {', '.join(names)}"
        for kind, drivers in (("supply", SUPPLIES), ("camera", CAMERAS))
        for origin, names in (("of other packages", drivers.announced()), ("of this program", drivers.added()))
        if names
    )


def list_serial_ports() -> tuple[Found, ...]:
    """Serial ports, from pyserial."""
    return tuple(
        Found(
            kind="supply",
            driver="korad" if (port.vid, port.pid) in KORAD_USB_IDS else SERIAL_DRIVERS,
            address=port.device,
            text=port.description if port.description not in (None, "n/a") else "serial port",
        )
        for port in sorted(list_ports.comports(), key=lambda port: str(port.device))
    )


def list_visa_resources() -> tuple[tuple[Found, ...], tuple[str, ...]]:
    """VISA resources that are no serial ports, and notes on buses that could not be searched."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            names = pyvisa.ResourceManager(visa_library()).list_resources("?*::INSTR")
        except (OSError, ValueError, pyvisa.errors.Error) as error:
            return (), (f"VISA: cannot be searched: {error}",)
    notes = [f"VISA: {warning.message}" for warning in caught if warning.category is UserWarning]
    found = tuple(
        Found(kind="supply", driver=SCPI_DRIVERS, address=name, text="VISA resource")
        for name in names
        if not name.startswith("ASRL")
    )
    return found, tuple(dict.fromkeys(notes))


VIDEO_DEVICES = Path("/sys/class/video4linux")


def list_cameras(devices: Path = VIDEO_DEVICES) -> tuple[Found, ...]:
    """Cameras as Linux lists them; the second nodes that cameras have for metadata are left out."""
    if not devices.is_dir():
        return ()
    found = []
    for device in sorted(devices.glob("video*"), key=lambda path: int(path.name.removeprefix("video"))):
        if (device / "index").read_text().strip() == "0":
            text = (device / "name").read_text().strip()
            found.append(Found("camera", "opencv", device.name.removeprefix("video"), text))
    return tuple(found)


def list_basler_cameras() -> tuple[Found, ...]:
    """Basler cameras, by their serial numbers; none where pypylon is not installed."""
    try:
        from pypylon import pylon
    except ImportError:
        return ()
    devices = pylon.TlFactory.GetInstance().EnumerateDevices()
    return tuple(Found("camera", "basler", d.GetSerialNumber(), d.GetModelName()) for d in devices)
