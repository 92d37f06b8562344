"""Serve emulated supplies in the same process, on a pseudo-terminal or on a TCP port."""

from __future__ import annotations

import os
import select
import socketserver
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from eimi_drivers.emulators.aim_tti import AimTtiDialect
from eimi_drivers.emulators.channel_selected import (
    KeysightE3631ADialect,
    RigolDp800Dialect,
    RohdeSchwarzHmpDialect,
)
from eimi_drivers.emulators.delta import DeltaPscEthDialect, DeltaSm15kDialect
from eimi_drivers.emulators.genesys import GenesysDialect
from eimi_drivers.emulators.keithley import Keithley2200Dialect, Keithley2260BDialect
from eimi_drivers.emulators.keysight_systems import (
    KeysightN6700Dialect,
    KeysightN6900Dialect,
    KeysightRp7900Dialect,
)
from eimi_drivers.emulators.korad import KoradDialect
from eimi_drivers.emulators.owon import OwonSpeDialect
from eimi_drivers.emulators.scpi import ScpiDialect
from eimi_drivers.emulators.scpi_families import (
    KepcoBit4886Dialect,
    KepcoBopDialect,
    KeysightE364xDialect,
    KeysightE3632ADialect,
    KeysightE36312ADialect,
    SiglentSpdDialect,
)
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.emulators.xln import XlnDialect
from eimi_drivers.installed import did_you_mean
from eimi_drivers.interfaces import InstrumentError, Limits, PowerSupply
from eimi_drivers.supplies.address import split_address
from eimi_drivers.supplies.supply_names import supply_driver
from eimi_drivers.supplies.transport import InProcessTransport, Responder

DIALECTS: dict[str, Callable[..., Responder]] = {
    "korad": KoradDialect,
    "scpi": ScpiDialect,
    "keysight-e36312a": KeysightE36312ADialect,
    "keysight-n6700": KeysightN6700Dialect,
    "keysight-e3631a": KeysightE3631ADialect,
    "keysight-e3632a": KeysightE3632ADialect,
    "keysight-e364x": KeysightE364xDialect,
    "rigol-dp800": RigolDp800Dialect,
    "siglent-spd": SiglentSpdDialect,
    "rs-hmp": RohdeSchwarzHmpDialect,
    "genesys": GenesysDialect,
    "kepco-bop": KepcoBopDialect,
    "kepco-bit4886": KepcoBit4886Dialect,
    "aim-tti": AimTtiDialect,
    "keysight-n6900": KeysightN6900Dialect,
    "keysight-rp7900": KeysightRp7900Dialect,
    "keithley-2200": Keithley2200Dialect,
    "keithley-2260b": Keithley2260BDialect,
    "delta-sm15k": DeltaSm15kDialect,
    "delta-psc-eth": DeltaPscEthDialect,
    "bk-xln": XlnDialect,
    "owon-spe": OwonSpeDialect,
}
"""The emulated supplies by the names of the drivers that control them. Each value makes an emulated supply."""


def emulate(dialect: str, supply: CoilSupply, address: str = "") -> Responder:
    """Return an emulated supply that answers the messages of one family of supplies.

    Parameters
    ----------
    dialect : str
        The name of the family in `DIALECTS`.
    supply : CoilSupply
        The model of the supply and its coil.
    address : str
        The address in the rig file, which contains the channel that feeds the coil.

    Returns
    -------
    Responder
        The emulated supply.

    Raises
    ------
    InstrumentError
        No family has this name.
    """
    if dialect not in DIALECTS:
        raise InstrumentError(
            f"there is no emulated supply {dialect!r}; the names are: {', '.join(DIALECTS)}"
            f"{did_you_mean(dialect, DIALECTS)}"
        )
    first, last = getattr(supply_driver(dialect), "channels", (1, 1))
    channel = split_address(address)[1]
    if channel is None or first == last:
        return DIALECTS[dialect](supply)
    return DIALECTS[dialect](supply, channel)


def open_in_process(driver: str, supply: CoilSupply, limits: Limits) -> PowerSupply:
    """Connect a driver to an emulated supply in the same process, and return the open supply."""
    link = InProcessTransport(emulate(driver, supply), supply.clock, address=f"emulated {driver}")
    return supply_driver(driver)(link, limits, supply.clock)


def open_terminal() -> tuple[int, int, str]:
    """Open a pseudo-terminal for an emulated instrument.

    Returns
    -------
    tuple of (int, int, str)
        The file descriptor of the instrument's end, the file descriptor of the driver's end, and the path that the
        driver opens.

    Raises
    ------
    InstrumentError
        The operating system has no pseudo-terminals.
    """
    if sys.platform == "win32":
        raise InstrumentError("Windows has no pseudo-terminals; serve on a TCP port: `eimi emulate SUPPLY --tcp 0`")
    import tty

    device_end, driver_end = os.openpty()
    tty.setraw(driver_end)
    return device_end, driver_end, os.ttyname(driver_end)


@contextmanager
def serve_pty(instrument: Responder) -> Iterator[str]:
    """Serve an emulated instrument on a pseudo-terminal while the `with` block runs, and yield the path of the port.

    Raises InstrumentError if the operating system has no pseudo-terminals.
    """
    device_end, driver_end, path = open_terminal()
    wake_read, wake_write = os.pipe()
    # A `FaultyInstrument` contains the emulated supply.
    begin = getattr(getattr(instrument, "instrument", instrument), "connect_serially", None)
    if begin:
        begin()

    def answer_until_stopped() -> None:
        # The driver's end also stays open here, because the line would hang up when the first driver closes it.
        with suppress(OSError):  # a fault or the other side cut the line
            while wake_read not in (ready := select.select([device_end, wake_read], [], [])[0]):
                if ready:
                    os.write(device_end, instrument.receive(os.read(device_end, 4096)))
        os.close(driver_end)
        os.close(device_end)

    thread = threading.Thread(target=answer_until_stopped, name=f"emulator {path}", daemon=True)
    thread.start()
    try:
        yield path
    finally:
        os.close(wake_write)
        thread.join()
        os.close(wake_read)


@contextmanager
def serve_tcp(instrument: Responder, host: str = "127.0.0.1", port: int = 0) -> Iterator[str]:
    """Serve an emulated instrument on a TCP port while the `with` block runs, and yield the VISA address of the socket.

    Parameters
    ----------
    instrument : Responder
        The emulated instrument.
    host : str
        The IP address of the network interface on which the port is opened.
    port : int
        The TCP port; 0 selects a free port.

    Raises
    ------
    InstrumentError
        The port is in use, or the address belongs to no interface of this computer.
    """
    lock = threading.Lock()

    class Connection(socketserver.BaseRequestHandler):
        def handle(self) -> None:
            with suppress(OSError):  # a fault or the other side cut the line
                while data := self.request.recv(4096):
                    with lock:
                        answer = instrument.receive(data)
                    self.request.sendall(answer)

    class Server(socketserver.ThreadingTCPServer):
        allow_reuse_address = sys.platform != "win32"  # on Windows a second server could take the port away
        daemon_threads = True
        block_on_close = False

    try:
        server = Server((host, port), Connection)
    except OSError as error:
        raise InstrumentError(f"cannot serve on {host}:{port}: {error}") from error
    with server:
        thread = threading.Thread(target=server.serve_forever, args=(0.05,), name="emulator", daemon=True)
        thread.start()
        try:
            yield f"TCPIP::{host}::{server.server_address[1]}::SOCKET"
        finally:
            server.shutdown()
            thread.join()
