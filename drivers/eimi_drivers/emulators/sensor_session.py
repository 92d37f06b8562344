"""Serve an emulated sensor in the field of an emulated coil, with one fault that begins after some time."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager

from eimi_drivers.clock import WallClock
from eimi_drivers.emulators.coil_line import RemoteCoil
from eimi_drivers.emulators.faults import LINE_FAULTS, Fault, FaultyInstrument
from eimi_drivers.emulators.sensors import EmulatedQuantity, SensorFault, emulate_sensor
from eimi_drivers.emulators.serial_port import serve_port
from eimi_drivers.emulators.serve import serve_pty, serve_tcp

LOOK_EVERY_S = 0.05
NOISE_MT = 0.005
"""Standard deviation of a reading of the emulated sensor."""

SENSOR_FAULTS: dict[str, Fault | SensorFault] = {
    fault.word: fault for fault in (*sorted(LINE_FAULTS - {Fault.REENUMERATE}, key=lambda f: f.word), *SensorFault)
}
"""The faults of a sensor and its line, by their names on the command line."""


class EmulatedSensorSession:
    """Serve an emulated gaussmeter on a serial port or a TCP port.

    Parameters
    ----------
    driver : str
        The dialect, see `SENSOR_DIALECTS`.
    tcp : int or None
        The TCP port, 0 for a free one; None serves on a pseudo-terminal.
    coil : str or None
        The address of an emulated coil, as `eimi emulate SUPPLY` prints it; None for no current.
    mT_per_A, offset_mT : float
        The true field at the probe.
    fault : Fault, SensorFault or None
        The fault.
    after_s : float
        Time (s) from the start until the fault begins.
    say : callable
        Receives the text for the user: the address, and the beginning of the fault.

    Raises
    ------
    InstrumentError
        No emulated coil answers at the address.
    """

    def __init__(
        self,
        driver: str,
        tcp: int | None,
        coil: str | None,
        mT_per_A: float,
        offset_mT: float,
        fault: Fault | SensorFault | None,
        after_s: float,
        say: Callable[[str], None],
    ) -> None:
        self._driver, self._tcp, self._fault, self._after_s, self._say = driver, tcp, fault, after_s, say
        self._clock = WallClock()
        self._coil = RemoteCoil(coil) if coil else None
        self._field = (mT_per_A, offset_mT)
        self._quantity = EmulatedQuantity(self._clock, self.field_mT, "mT", NOISE_MT)
        self._line = FaultyInstrument(emulate_sensor(driver, self._quantity), self._clock)

    def field_mT(self) -> float:
        """Return the true field at the probe now."""
        mT_per_A, offset_mT = self._field
        return offset_mT + mT_per_A * (self._coil.coil_current_A() if self._coil else 0.0)

    def serve(self) -> None:
        """Serve until the program is interrupted."""
        began_s = self._clock.now()
        with self._serve() as address:
            self._say(f'driver = "{self._driver}"\naddress = "{address}"')
            waiting = self._fault
            while True:
                if waiting is not None and self._clock.now() - began_s >= self._after_s:
                    self._begin(waiting)
                    waiting = None
                self._clock.sleep(LOOK_EVERY_S)

    def _begin(self, fault: Fault | SensorFault) -> None:
        if isinstance(fault, SensorFault):
            self._quantity.fault = fault
        else:
            self._line.inject(fault)
        self._say(f"# the fault {fault.word} begins: {fault.effect}")

    def _serve(self) -> AbstractContextManager[str]:
        if self._tcp is not None:
            return serve_tcp(self._line, port=self._tcp)
        return serve_pty(self._line) if self._fault is None else serve_port(self._line, "ttySENSOR")
