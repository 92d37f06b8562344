"""Serve an emulated gaussmeter in the field of an emulated coil, with at most one fault."""

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
"""Standard deviation of the values of the emulated gaussmeter, mT."""

SENSOR_FAULTS: dict[str, Fault | SensorFault] = {
    fault.word: fault for fault in (*sorted(LINE_FAULTS - {Fault.REENUMERATE}, key=lambda f: f.word), *SensorFault)
}
"""The faults of a sensor and of its line, by their names in the options of commands."""


class EmulatedSensorSession:
    """An emulated gaussmeter on a serial port or a TCP port.

    Parameters
    ----------
    driver : str
        The name of the emulated sensor in `SENSOR_DIALECTS`.
    tcp : int or None
        The TCP port; 0 selects a free port. None serves the gaussmeter on a pseudo-terminal.
    coil : str or None
        The address of an emulated coil, as `eimi emulate SUPPLY` prints it. None means that no current flows.
    mT_per_A : float
        The coil constant at the probe, mT/A.
    offset_mT : float
        The field at the probe without a current, mT.
    fault : Fault, SensorFault or None
        The fault of the sensor or of its connection; None for no fault.
    after_s : float
        The time from the start until the fault begins, s.
    say : callable
        Takes the texts for the user.

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
        """Return the present true field at the probe, mT."""
        mT_per_A, offset_mT = self._field
        return offset_mT + mT_per_A * (self._coil.coil_current_A() if self._coil else 0.0)

    def serve(self) -> None:
        """Serve the emulated gaussmeter until the program is interrupted."""
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
