"""Read the address of an instrument: a serial port, a VISA resource or a URL, and the channel at its end."""

from __future__ import annotations

import logging
import os
import re
from urllib.parse import urlsplit

from eimi_drivers.interfaces import raised
from eimi_drivers.serial_ports import attached_ports

_log = logging.getLogger(__name__)

_VISA_SERIAL = re.compile(r"ASRL(.+?)(?:::INSTR)?", re.IGNORECASE)
_VISA_SOCKET = re.compile(r"TCPIP\d*::([^:]+)::(\d+)::SOCKET", re.IGNORECASE)
_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*://")
SERIAL_URLS = ("socket://", "rfc2217://")
"""The permitted pyserial URLs. Other URLs can do harm: ``spy://`` overwrites the file in the URL."""
_PSEUDO_TERMINAL = re.compile(r"/dev/(?:pts/|ttys)\d+")
_CHANNEL = re.compile(r"(.*)#(\d{1,3})")


def split_address(address: str) -> tuple[str, int | None]:
    """Return an address without its channel, and the number of the channel (2 for ``#2``; None without a channel)."""
    match = _CHANNEL.fullmatch(address)
    return (match[1], int(match[2])) if match else (address, None)


def pseudo_terminal(address: str) -> str:
    """Return the path of the pseudo-terminal (a serial port in software) in an address; empty if there is none."""
    match = _PSEUDO_TERMINAL.search(address)
    return match[0] if match else ""


def usb_serial_number(address: str) -> str:
    """Return the serial number of the USB device of a serial port; empty if it cannot be found."""
    port = serial_port(address)
    name = os.path.realpath(port) if port.startswith("/") else port.upper()
    if not name.startswith(("/", "COM")) or pseudo_terminal(name):
        return ""
    try:
        devices = attached_ports()
    except Exception as error:  # without a serial number the supply counts as a supply that cannot be identified
        _log.info("the serial ports cannot be listed: %s", raised(error))
        return ""
    return next((str(device.serial_number or "") for device in devices if device.device == name), "")


def serial_port(address: str) -> str:
    """Return the name or the URL with which pyserial opens an address."""
    place = split_address(address)[0].removeprefix("\\\\.\\")  # Windows prefix of COM10 and above; pyserial adds it
    if match := _VISA_SERIAL.fullmatch(place):
        return f"COM{match[1]}" if match[1].isdecimal() else match[1]
    match = _VISA_SOCKET.fullmatch(place)
    return f"socket://{match[1]}:{match[2]}" if match else place


def check_address(address: str) -> None:
    """Raise ValueError if an address is a URL without host and port, or does not begin with one of `SERIAL_URLS`."""
    port = serial_port(address)
    url = _URL.match(port)
    if url and not url[0].lower().startswith(SERIAL_URLS):
        kinds = " or ".join(SERIAL_URLS)
        raise ValueError(
            f"{url[0]} is not supported; give a port such as /dev/ttyUSB0, or a URL that begins with {kinds}"
        )
    if url and not _has_host_and_port(port):
        raise ValueError(f"needs a host and a port from 1 to 65535, such as {url[0]}192.168.0.5:8000")


def _has_host_and_port(url: str) -> bool:
    try:
        place = urlsplit(url)
        return bool(place.hostname and place.port)
    except ValueError:  # the port is no number from 0 to 65535
        return False


def is_serial_port(address: str) -> bool:
    """Return whether an address is a serial port."""
    place = split_address(address)[0]
    return "::" not in place or _VISA_SERIAL.fullmatch(place) is not None
