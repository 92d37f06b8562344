"""List the serial ports of this computer with pyserial."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any


def attached_ports() -> Iterable[Any]:
    """Return the serial ports of this computer, each as a `ListPortInfo` of pyserial.

    Raises
    ------
    OSError
        The operating system cannot list its ports.
    """
    try:
        from serial.tools import list_ports
    except (ImportError, AttributeError) as error:  # pyserial looks for functions of Windows that Wine lacks
        raise OSError(f"this operating system does not list its serial ports ({error})") from error
    return list_ports.comports()
