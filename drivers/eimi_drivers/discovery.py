"""What is attached, and the driver that would serve it. Nothing is opened: a supply may be in use."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pyvisa
from serial.tools import list_ports

KORAD_USB_IDS = frozenset({(0x0416, 0x5011)})
"""Vendor and product of the USB serial chip in Korad, Tenma and RND supplies; some printers have it too."""


@dataclass(frozen=True)
class Found:
    """Something that a rig file could name.

    driver: the driver that would serve it; "korad or scpi" for a serial port that does not say what is
    behind it.
    address: what goes into the rig file as address (supply) or source (camera).
    text: what the operating system calls it.
    """

    kind: Literal["supply", "camera"]
    driver: str
    address: str
    text: str


@dataclass(frozen=True)
class Discovery:
    """found: what is attached. notes: where could not be searched, and why."""

    found: tuple[Found, ...]
    notes: tuple[str, ...]


def discover() -> Discovery:
    """List serial ports, VISA resources and cameras. Takes a second, for answers from the LAN (VXI-11)."""
    resources, notes = list_visa_resources()
    cameras = list_cameras()
    if not cameras and not VIDEO_DEVICES.is_dir():
        notes = (*notes, "cameras: this system lists none; try the indices 0, 1, 2 as the camera's source")
    return Discovery(found=(*list_serial_ports(), *resources, *cameras), notes=notes)


def list_serial_ports() -> tuple[Found, ...]:
    """Serial ports, from pyserial."""
    return tuple(
        Found(
            kind="supply",
            driver="korad" if (port.vid, port.pid) in KORAD_USB_IDS else "korad or scpi",
            address=port.device,
            text=port.description or "serial port",
        )
        for port in sorted(list_ports.comports(), key=lambda port: str(port.device))
    )


def list_visa_resources() -> tuple[tuple[Found, ...], tuple[str, ...]]:
    """VISA resources that are no serial ports, and notes on buses that could not be searched."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            names = pyvisa.ResourceManager("@py").list_resources("?*::INSTR")
        except (OSError, ValueError, pyvisa.errors.Error) as error:
            return (), (f"VISA: cannot be searched: {error}",)
    notes = [f"VISA: {warning.message}" for warning in caught if warning.category is UserWarning]
    found = tuple(
        Found(kind="supply", driver="scpi", address=name, text="VISA resource")
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
