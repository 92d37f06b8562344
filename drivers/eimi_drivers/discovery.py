"""List the instruments that are attached to this computer, and the driver for each instrument."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import pyvisa

from eimi_drivers.cameras import CAMERAS
from eimi_drivers.cameras.aravis import attached_cameras
from eimi_drivers.cameras.aravis_library import aravis_is_installed, load_aravis
from eimi_drivers.cameras.gentl import producer_files
from eimi_drivers.interfaces import raised
from eimi_drivers.lan_instruments import list_lan_instruments
from eimi_drivers.serial_ports import attached_ports
from eimi_drivers.supplies import SUPPLIES
from eimi_drivers.supplies.visa import visa_library

KORAD_USB_IDS = frozenset({(0x0416, 0x5011)})
"""USB vendor and product numbers of the serial chip in Korad, Tenma and RND supplies.

Some printers contain the same chip.
"""

SENSOR_USB_IDS = {(0x1FB9, 0x0401): "lakeshore-425", (0x1FB9, 0x0403): "lakeshore-475"}
"""The driver for each gaussmeter, by USB vendor and product number (source: Linux, drivers/usb/serial/cp210x.c)."""

BOARD_USB_VENDORS = {
    **{0x2341: "Arduino", 0x2A03: "Arduino", 0x239A: "Adafruit", 0x1B4F: "SparkFun"},
    **{0x2E8A: "Raspberry Pi", 0x303A: "Espressif", 0x16C0: "Teensy"},
}
"""Makers of microcontroller boards by USB vendor number.

Such a board may carry a sensor that answers queries in lines of text (driver "text-line").
"""

SERIAL_DRIVERS = "korad, genesys, aim-tti, a SCPI driver or the driver of a sensor"
SCPI_DRIVERS = "scpi or the driver of the family"


@dataclass(frozen=True)
class Found:
    """An instrument that was found, with the values that a rig file (the list of a set-up's instruments) needs.

    Parameters
    ----------
    kind : "supply", "camera" or "sensor"
        Kind of instrument.
    driver : str
        Name of the driver; a list of possible drivers if the port does not identify the instrument.
    address : str
        Value for the rig file: `address` of a supply or a sensor, `source` of a camera.
    text : str
        Description of the instrument.
    """

    kind: Literal["supply", "camera", "sensor"]
    driver: str
    address: str
    text: str


@dataclass(frozen=True)
class Discovery:
    """The result of a search for instruments.

    Parameters
    ----------
    found : tuple of Found
        Instruments that were found.
    notes : tuple of str
        Remarks for the user, such as a search that failed.
    """

    found: tuple[Found, ...]
    notes: tuple[str, ...]


def discover() -> Discovery:
    """Return the attached instruments: serial ports, instruments on the network, VISA resources and cameras.

    The search takes some seconds.
    """
    with ThreadPoolExecutor(max_workers=1) as network:  # the search by mDNS waits some seconds
        announced = network.submit(_search, "instruments of the network (mDNS)", list_network)
        ports, port_notes = _search("serial ports", list_serial_ports)
        others, notes = list_visa_resources()
        lan, lan_notes = announced.result()
    hosts = {_host(instrument.address) for instrument in lan}
    resources = (*lan, *(resource for resource in others if _host(resource.address) not in hosts))
    attached, camera_notes = _search("cameras", list_cameras)
    basler, basler_notes = _search("Basler cameras", list_basler_cameras)
    genicam, genicam_notes = _search("GigE Vision and USB3 Vision cameras", list_genicam_cameras)
    gentl, gentl_notes = _search("cameras of GenTL producers", list_gentl_cameras)
    cameras = (*attached, *basler, *genicam, *gentl)
    return Discovery(
        found=(*ports, *resources, *cameras),
        notes=(
            *(*port_notes, *lan_notes, *notes, *camera_notes, *basler_notes, *genicam_notes, *gentl_notes),
            *(_no_permission(found.address) for found in ports if _forbidden(found.address)),
            *((NO_SUPPLY,) if not (ports or resources) else ()),
            *(() if cameras else (NO_CAMERA if VIDEO_DEVICES.is_dir() else UNLISTED_CAMERAS,)),
            *_drivers_from_elsewhere(),
        ),
    )


def _search(kind: str, search: Callable[[], tuple[Found, ...]]) -> tuple[tuple[Found, ...], tuple[str, ...]]:
    """Return the instruments that `search` finds and no note; after an error no instrument and one note."""
    try:
        return search(), ()
    except Exception as error:  # the libraries of other projects can raise any exception
        return (), (f"{kind}: the search failed: {raised(error)}",)


NO_SUPPLY = (
    "supplies: none found. Is the supply on and its cable plugged in? A supply on the LAN that does not announce "
    "itself cannot be listed: write its address into the rig file, such as TCPIP::host::5025::SOCKET"
)
NO_CAMERA = (
    "cameras: none found. Is the camera's cable plugged in? Industrial cameras need the library Aravis (`apt install "
    "libaravis-0.8-0` or `brew install aravis`), or for Basler cameras pip install 'eimi-lab[basler]'"
)
UNLISTED_CAMERAS = "cameras: this operating system does not list cameras; try 0, 1 or 2 as the camera's source"


def _forbidden(port: str) -> bool:
    return os.path.exists(port) and not os.access(port, os.R_OK | os.W_OK)


def _no_permission(port: str) -> str:
    return (
        f"{port}: no permission to open this port; on Linux, add your user to the group of the port (dialout or uucp) "
        "and log in again"
    )


def _drivers_from_elsewhere() -> tuple[str, ...]:
    return tuple(
        f"{kind} drivers {origin}: {', '.join(names)}"
        for kind, drivers in (("supply", SUPPLIES), ("camera", CAMERAS))
        for origin, names in (("of other packages", drivers.announced()), ("of this program", drivers.added()))
        if names
    )


def list_serial_ports() -> tuple[Found, ...]:
    """Return the serial ports of this computer. No message is sent to a port.

    The driver of a port is known only if its USB numbers identify the instrument.
    """
    ports = sorted(attached_ports(), key=lambda port: str(port.device))
    return tuple(_serial_instrument(port) for port in ports)


def _serial_instrument(port: Any) -> Found:
    text = _described(port.description, port.serial_number)
    if driver := SENSOR_USB_IDS.get((port.vid, port.pid)):
        return Found("sensor", driver, port.device, text)
    if board := BOARD_USB_VENDORS.get(port.vid):
        return Found("sensor", "text-line", port.device, f"{board} board: {text}")
    driver = "korad" if (port.vid, port.pid) in KORAD_USB_IDS else SERIAL_DRIVERS
    return Found("supply", driver, port.device, text)


def list_network() -> tuple[Found, ...]:
    """Return the instruments that announce themselves on the network. No connection is opened."""
    return tuple(
        Found(
            kind="supply",
            driver=instrument.recognised.driver if instrument.recognised else SCPI_DRIVERS,
            address=instrument.address or f"TCPIP::{instrument.host}::5025::SOCKET",
            text=instrument.text if instrument.address else f"{instrument.text}; port 5025 is assumed, see its manual",
        )
        for instrument in list_lan_instruments()
    )


def _host(address: str) -> str:
    """Return the host in the address of a VISA resource; the whole address if it contains no host."""
    parts = address.split("::")
    return parts[1] if parts[0].upper().startswith("TCPIP") and len(parts) > 2 else address


def _described(description: str | None, serial_number: str | None) -> str:
    """Return the description of a port, with the serial number of its USB adapter if it has one."""
    text = description if description not in (None, "n/a") else "serial port"
    return f"{text}, serial number {serial_number}" if serial_number else f"{text}"


def list_visa_resources() -> tuple[tuple[Found, ...], tuple[str, ...]]:
    """Return the instruments that VISA lists, without serial ports, and a note for each search that failed."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            names = pyvisa.ResourceManager(visa_library()).list_resources("?*::INSTR")
        except Exception as error:  # a VISA library can raise any exception
            return (), (f"VISA: the search failed: {raised(error)}",)
    notes = [f"VISA: {warning.message}" for warning in caught if warning.category is UserWarning]
    resources = tuple(
        Found(kind="supply", driver=SCPI_DRIVERS, address=name, text="VISA resource")
        for name in names
        if not name.startswith("ASRL")
    )
    return resources, tuple(dict.fromkeys(notes))


VIDEO_DEVICES = Path("/sys/class/video4linux")


def list_cameras(devices: Path = VIDEO_DEVICES) -> tuple[Found, ...]:
    """Return the cameras that Linux lists in the folder `devices`; an empty tuple if the folder does not exist."""
    if not devices.is_dir():
        return ()
    cameras = []
    for device in sorted(devices.glob("video*"), key=lambda path: int(path.name.removeprefix("video"))):
        if (device / "index").read_text().strip() == "0":
            text = (device / "name").read_text().strip()
            cameras.append(Found("camera", "opencv", device.name.removeprefix("video"), text))
    return tuple(cameras)


def list_basler_cameras() -> tuple[Found, ...]:
    """Return the Basler cameras with their serial numbers; an empty tuple if pypylon is not installed."""
    try:
        from pypylon import pylon
    except ImportError:
        return ()
    devices = pylon.TlFactory.GetInstance().EnumerateDevices()
    return tuple(Found("camera", "basler", d.GetSerialNumber(), d.GetModelName()) for d in devices)


def list_genicam_cameras() -> tuple[Found, ...]:
    """Return the GigE Vision and USB3 Vision cameras with serial numbers; an empty tuple if Aravis is not installed."""
    if not aravis_is_installed():
        return ()
    return tuple(
        Found(
            "camera",
            "aravis",
            camera.serial_number,
            f"{camera.model}, {camera.protocol}{f' at {camera.address}' if camera.address else ''}",
        )
        for camera in attached_cameras(load_aravis())
    )


def list_gentl_cameras() -> tuple[Found, ...]:
    """Return the cameras of the installed GenTL producers (camera drivers of the GenICam standard).

    The tuple is empty if no producer or no package ``harvesters`` is installed.
    """
    if not producer_files():
        return ()
    try:
        from harvesters.core import Harvester
    except ImportError:
        return ()
    producers = Harvester()
    try:
        for file in producer_files():
            producers.add_file(str(file))
        producers.update()
        return tuple(
            Found("camera", "gentl", device.serial_number, f"{device.vendor} {device.model}")
            for device in producers.device_info_list
        )
    finally:
        producers.reset()
