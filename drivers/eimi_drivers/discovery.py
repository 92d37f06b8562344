"""List the attached instruments and the driver for each. No supply is opened, because it may be in use."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pyvisa

from eimi_drivers.cameras import CAMERAS
from eimi_drivers.interfaces import raised
from eimi_drivers.serial_ports import attached_ports
from eimi_drivers.supplies import SUPPLIES
from eimi_drivers.supplies.transport import visa_library

KORAD_USB_IDS = frozenset({(0x0416, 0x5011)})
"""USB vendor and product numbers of the serial chip in Korad, Tenma and RND supplies; some printers have it too."""

SERIAL_DRIVERS = "korad, genesys or one of the SCPI drivers"
SCPI_DRIVERS = "scpi or the family's own"


@dataclass(frozen=True)
class Found:
    """Describe an attached instrument that a rig file can name.

    Parameters
    ----------
    kind : "supply" or "camera"
        The kind of instrument.
    driver : str
        The name of the driver. If the port does not identify the instrument, the possible drivers joined by "or".
    address : str
        The value for the rig file: `address` of a supply, `source` of a camera.
    text : str
        The operating system's description of the instrument.
    """

    kind: Literal["supply", "camera"]
    driver: str
    address: str
    text: str


@dataclass(frozen=True)
class Discovery:
    """Hold the result of a search for instruments.

    Parameters
    ----------
    found : tuple of Found
        The attached instruments.
    notes : tuple of str
        Sentences for the user about searches that failed, ports that cannot be opened and instruments that are
        missing, each with a remedy.
    """

    found: tuple[Found, ...]
    notes: tuple[str, ...]


def discover() -> Discovery:
    """List serial ports, VISA resources and cameras. The search waits one second for answers from the LAN (VXI-11)."""
    ports, port_notes = _search("serial ports", list_serial_ports)
    resources, notes = list_visa_resources()
    attached, camera_notes = _search("cameras", list_cameras)
    basler, basler_notes = _search("Basler cameras", list_basler_cameras)
    cameras = (*attached, *basler)
    return Discovery(
        found=(*ports, *resources, *cameras),
        notes=(
            *(*port_notes, *notes, *camera_notes, *basler_notes),
            *(_no_permission(found.address) for found in ports if _forbidden(found.address)),
            *((NO_SUPPLY,) if not (ports or resources) else ()),
            *(() if cameras else (NO_CAMERA if VIDEO_DEVICES.is_dir() else UNLISTED_CAMERAS,)),
            *_drivers_from_elsewhere(),
        ),
    )


def _search(kind: str, search: Callable[[], tuple[Found, ...]]) -> tuple[tuple[Found, ...], tuple[str, ...]]:
    """Return the instruments that a search found, and a note if the library of the search raised an error."""
    try:
        return search(), ()
    except Exception as error:  # these libraries belong to others and can raise anything
        return (), (f"{kind}: cannot be searched: {raised(error)}",)


NO_SUPPLY = (
    "supplies: none found. Is the supply on and its cable plugged in? A supply on the LAN that answers only on "
    "a raw socket cannot be listed: write its address into the rig file, TCPIP::host::5025::SOCKET"
)
NO_CAMERA = (
    "cameras: none found. Is the camera's cable plugged in? Basler cameras need the extra: "
    "pip install 'eimi-lab[basler]'"
)
UNLISTED_CAMERAS = "cameras: this operating system does not list cameras; try 0, 1 or 2 as the camera's source"


def _forbidden(port: str) -> bool:
    return os.path.exists(port) and not os.access(port, os.R_OK | os.W_OK)


def _no_permission(port: str) -> str:
    return f"{port}: no permission to open this port; on Linux, join its group (dialout or uucp), then log in again"


def _drivers_from_elsewhere() -> tuple[str, ...]:
    return tuple(
        f"{kind} drivers {origin}: {', '.join(names)}"
        for kind, drivers in (("supply", SUPPLIES), ("camera", CAMERAS))
        for origin, names in (("of other packages", drivers.announced()), ("of this program", drivers.added()))
        if names
    )


def list_serial_ports() -> tuple[Found, ...]:
    """List the serial ports with pyserial."""
    return tuple(
        Found(
            kind="supply",
            driver="korad" if (port.vid, port.pid) in KORAD_USB_IDS else SERIAL_DRIVERS,
            address=port.device,
            text=_described(port.description, port.serial_number),
        )
        for port in sorted(attached_ports(), key=lambda port: str(port.device))
    )


def _described(description: str | None, serial_number: str | None) -> str:
    """Describe a port as the operating system does; the serial number distinguishes two adapters of one type."""
    text = description if description not in (None, "n/a") else "serial port"
    return f"{text}, serial number {serial_number}" if serial_number else f"{text}"


def list_visa_resources() -> tuple[tuple[Found, ...], tuple[str, ...]]:
    """Return the VISA resources except serial ports, and notes about buses that could not be searched."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            names = pyvisa.ResourceManager(visa_library()).list_resources("?*::INSTR")
        except Exception as error:  # a VISA library can raise anything
            return (), (f"VISA: cannot be searched: {raised(error)}",)
    notes = [f"VISA: {warning.message}" for warning in caught if warning.category is UserWarning]
    resources = tuple(
        Found(kind="supply", driver=SCPI_DRIVERS, address=name, text="VISA resource")
        for name in names
        if not name.startswith("ASRL")
    )
    return resources, tuple(dict.fromkeys(notes))


VIDEO_DEVICES = Path("/sys/class/video4linux")


def list_cameras(devices: Path = VIDEO_DEVICES) -> tuple[Found, ...]:
    """List the cameras that Linux knows, without the additional device nodes that contain only metadata."""
    if not devices.is_dir():
        return ()
    cameras = []
    for device in sorted(devices.glob("video*"), key=lambda path: int(path.name.removeprefix("video"))):
        if (device / "index").read_text().strip() == "0":
            text = (device / "name").read_text().strip()
            cameras.append(Found("camera", "opencv", device.name.removeprefix("video"), text))
    return tuple(cameras)


def list_basler_cameras() -> tuple[Found, ...]:
    """List the Basler cameras with their serial numbers; return an empty tuple if pypylon is not installed."""
    try:
        from pypylon import pylon
    except ImportError:
        return ()
    devices = pylon.TlFactory.GetInstance().EnumerateDevices()
    return tuple(Found("camera", "basler", d.GetSerialNumber(), d.GetModelName()) for d in devices)
