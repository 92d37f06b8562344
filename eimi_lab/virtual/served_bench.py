"""Let other programs use the simulated instruments of a rig, by the protocols of real instruments."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eimi_drivers.clock import WallClock
from eimi_drivers.emulators.coil_line import ADDRESS, RemoteCoil, serve_coil
from eimi_drivers.emulators.faults import Fault
from eimi_drivers.emulators.gige_camera import LOOPBACK
from eimi_drivers.emulators.gige_process import CameraProcess, gige_process
from eimi_drivers.emulators.serve import serve_pty, serve_tcp
from eimi_drivers.emulators.session import EmulatedSession
from eimi_drivers.emulators.supply import CoilSupply
from eimi_drivers.supplies.address import split_address
from eimi_drivers.supplies.transport import Responder
from eimi_lab.config.rig import VIRTUAL, Rig
from eimi_lab.config.specimen import SpecimenFile
from eimi_lab.virtual.client_rig import DIALECT_OF_THE_VIRTUAL_SUPPLY, with_virtual_table, write_client_rig
from eimi_lab.virtual.virtual_rig import true_field_mT, truth_of, virtual_camera
from eimi_lab.virtual.virtual_sensors import emulated_instrument

TRIGGERS_PER_S = 10.0
"""Number of times per second at which the camera checks for a software trigger.

More checks would slow down the program that measures on the served bench.
"""

_LOCAL_PORT = re.compile(r"(TCPIP\d*::|socket://)(127[.\d]*|localhost)::?(?P<port>\d+)(::SOCKET)?", re.IGNORECASE)
_NETWORK = re.compile(r"(TCPIP|socket://|GPIB|USB)", re.IGNORECASE)


def port_of(address: str) -> int | None:
    """Return the TCP port on which the emulated instrument is served: 0 for any free port, None for a pseudo-terminal.

    `address` is the address of the real instrument in the rig file.
    """
    place = split_address(address)[0]
    if local := _LOCAL_PORT.fullmatch(place):
        return int(local["port"])
    return 0 if _NETWORK.match(place) or not hasattr(os, "openpty") else None


def pictures(rig: Rig, specimen: SpecimenFile, coil_line: str) -> Callable[[], NDArray[np.uint8]]:
    """Return a function without arguments that returns an 8-bit picture of the virtual beam, shape (height, width).

    The picture shows the beam at the present current of the coil that another process emulates at the address
    `coil_line`.
    """
    # With a frame rate, the virtual camera would return stored frames in their order, not the present beam.
    at_once = rig.model_copy(update={"camera": rig.camera.model_copy(update={"frame_rate_Hz": None})})
    camera = virtual_camera(at_once, specimen, RemoteCoil(coil_line), WallClock())
    left, top = rig.camera.region[:2] if rig.camera.region else (0, 0)

    def picture() -> NDArray[np.uint8]:
        image = camera.grab(1.0).image
        if image.dtype != np.uint8:
            bits = rig.virtual.optics.bits if rig.virtual else 16
            image = (image >> bits - 8).astype(np.uint8)
        # the frame of the camera is cut from a picture that begins at the corner of the sensor
        return np.pad(image, ((top, 0), (left, 0)))

    picture()  # the first picture takes longest, and is therefore taken before the camera is served
    return picture


class ServedBench:
    """A simulated bench whose instruments another program (the client) can use like real instruments.

    Parameters
    ----------
    rig : Rig
        The rig. If it has no table [virtual] (the parameters of a simulation), the table of the shipped virtual rig is
        used.
    specimen : SpecimenFile
        The specimen in the coil.
    path : Path
        The rig file to write for the client.
    say : callable
        Receives each line of text for the user.
    force : bool
        True if an existing rig file is replaced.
    fault : Fault or None
        A fault of the supply, of its coil or of its line; None for no fault.
    after_s : float
        Time (s) between the first current and the beginning of the fault.
    packet_loss : float
        Lost part of the packets of the camera, 0 to 1.

    Raises
    ------
    InputError
        If the rig or the specimen cannot be simulated.
    """

    def __init__(
        self,
        rig: Rig,
        specimen: SpecimenFile,
        path: Path,
        say: Callable[[str], None],
        *,
        force: bool = False,
        fault: Fault | None = None,
        after_s: float = 5.0,
        packet_loss: float = 0.0,
    ) -> None:
        self._rig, self._specimen = with_virtual_table(rig, specimen), specimen
        truth_of(self._rig, specimen)
        self._path, self._say, self._force = path, say, force
        self._fault, self._after_s, self._packet_loss = fault, after_s, packet_loss

    def serve(self) -> None:
        """Serve the instruments until the program is interrupted.

        Raises
        ------
        InstrumentError
            If an instrument has no emulator, a port is in use, or the library Aravis is not installed.
        InputError
            If the rig file for the client exists and may not be replaced.
        """
        rig, virtual = self._rig, self._rig.virtual
        assert virtual is not None
        coil = CoilSupply(
            WallClock(),
            time_constant_s=virtual.coil_time_constant_s,
            current_noise_A=virtual.current_noise_A,
            seed=virtual.seed,
        )
        with ExitStack() as served:
            source = str(rig.camera.source)
            coil_line = served.enter_context(
                serve_coil(coil, (port_of(source) if ADDRESS.fullmatch(source) else 0) or 0)
            )
            camera = served.enter_context(self._camera(coil_line))
            camera.lose_packets(self._packet_loss)
            field_mT = true_field_mT(rig, coil)
            sensors = {
                sensor.name: served.enter_context(
                    _served(emulated_instrument(sensor, field_mT, WallClock()), sensor.address)
                )
                for sensor in rig.sensors
                if not sensor.is_coil
            }
            simulated = rig.supply.driver == VIRTUAL
            EmulatedSession(
                DIALECT_OF_THE_VIRTUAL_SUPPLY if simulated else rig.supply.driver,
                port_of(rig.supply.address),
                self._fault,
                self._after_s,
                self._say,
                coil=coil,
                address=rig.supply.address,
                announce=partial(self._announce, sensors),
                look=camera.raise_failure,
            ).serve()

    def _camera(self, coil_line: str) -> AbstractContextManager[CameraProcess]:
        rig = self._rig
        assert rig.virtual is not None
        left, top = rig.camera.region[:2] if rig.camera.region else (0, 0)
        width, height = rig.virtual.frame_size_px
        return gige_process(
            partial(pictures, rig, self._specimen, coil_line),
            (left + width, top + height),
            address=LOOPBACK,
            triggers_per_s=TRIGGERS_PER_S,
        )

    def _announce(self, sensors: dict[str, str], supply_address: str, coil_line: str) -> None:
        channel = split_address(self._rig.supply.address)[1]
        address = supply_address if channel is None else f"{supply_address}#{channel}"
        write_client_rig(self._rig, self._path, address, LOOPBACK, sensors, self._force)
        self._force = True  # if the supply returns at another address, the file is written again
        listed = "".join(f", {name} at {place}" for name, place in sensors.items())
        self._say(f"supply at {address}, GigE camera at {LOOPBACK}{listed}")
        self._say(f"{self._path}: the rig of this bench, for `eimi acquire` in another terminal; Ctrl-C ends the bench")


def _served(instrument: Responder, address: str) -> AbstractContextManager[str]:
    port = port_of(address)
    return serve_pty(instrument) if port is None else serve_tcp(instrument, port=port)
